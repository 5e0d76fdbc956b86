//! Errors on the terminal, with the place underlined.

use miette::{Diagnostic, LabeledSpan, MietteHandlerOpts, NamedSource, Report, SourceCode};
use std::fmt;
use std::io::IsTerminal;
use voidage_coupling::Error;
use voidage_scene::{Location, SceneError};

/// Prints an error to stderr.
pub fn print(error: &Error) {
    if !std::io::stderr().is_terminal() {
        // Whoever reads a pipe wants whole lines. The hook is set once, so this cannot fail.
        let _ = miette::set_hook(Box::new(|_| {
            Box::new(MietteHandlerOpts::new().color(false).wrap_lines(false).build())
        }));
    }
    match error {
        Error::Scene(error) => eprintln!("{:?}", Report::new(Underlined::new(error))),
        other => {
            eprintln!("error: {}", other.notice());
        }
    }
}

/// An error of a scene as miette shows it.
#[derive(Debug)]
struct Underlined {
    message: String,
    help: String,
    source: NamedSource<String>,
    span: Option<(usize, usize)>,
}

impl Underlined {
    fn new(error: &SceneError) -> Self {
        let name = error.file.display();
        let (message, span) = match &error.location {
            Location::File { span, line, column } => {
                (format!("{name}:{line}:{column}: {}", error.notice.what), Some((span.start, span.len())))
            }
            Location::Set(option) => (format!("{name}: --set {option}: {}", error.notice.what), None),
        };
        let source = NamedSource::new(name.to_string(), error.text.to_string());
        Underlined { message, help: error.notice.help.clone(), source, span }
    }
}

impl fmt::Display for Underlined {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Underlined {}

impl Diagnostic for Underlined {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        (!self.help.is_empty()).then(|| Box::new(&self.help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.span.map(|_| &self.source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let (start, length) = self.span?;
        Some(Box::new(std::iter::once(LabeledSpan::new(None, start, length))))
    }
}
