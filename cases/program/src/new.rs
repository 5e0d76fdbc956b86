//! `voidage new`: a scene to begin with.

use crate::shipped::CASES;
use clap::Args;
use clap::builder::PossibleValuesParser;
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use voidage_coupling::{Error, Notice, Result};

/// A commented scene.
const TEMPLATE: &str = include_str!("../template.toml");

/// Options of `voidage new`.
#[derive(Args)]
pub struct Options {
    /// Name of the scene: the file is NAME.toml. An existing file is not touched.
    name: PathBuf,
    /// A shipped case to copy, instead of the commented template.
    #[arg(long, value_name = "CASE", value_parser = PossibleValuesParser::new(CASES.map(|(name, _)| name)))]
    like: Option<String>,
}

/// Writes a scene; the number is the exit code.
pub fn new(options: &Options) -> Result<u8> {
    let named = CASES.into_iter().find(|(name, _)| Some(*name) == options.like.as_deref());
    let text = named.map_or(TEMPLATE, |(_, text)| text);
    let file = file(&options.name);
    write(&file, text).map_err(|error| refusal(&file, error))?;
    println!("{0} is written; `voidage run {0}` runs it", file.display());
    Ok(0)
}

/// NAME.toml; a dot in the name is no end of a file but the one that is there already.
fn file(name: &Path) -> PathBuf {
    if name.extension().is_some_and(|end| end == "toml") {
        return name.to_path_buf();
    }
    let mut file = name.as_os_str().to_owned();
    file.push(".toml");
    file.into()
}

fn write(file: &Path, text: &str) -> std::io::Result<()> {
    File::create_new(file)?.write_all(text.as_bytes())
}

fn refusal(file: &Path, error: std::io::Error) -> Error {
    let (what, help) = match error.kind() {
        ErrorKind::AlreadyExists => ("there is such a file already", "give another name, or remove it"),
        ErrorKind::NotFound => ("there is no such folder", "make the folder first"),
        _ => return Error::file(file, "write", error),
    };
    Error::input(Notice::new(format!("{}: {what}", file.display()), help))
}
