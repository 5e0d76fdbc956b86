//! What documentation, comments and scripts name is there: files and folders of this repository, and links between
//! its pages.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

/// Folders with which the path of a file of this repository begins.
const TOPS: [&str; 5] = ["dem/", "fluid/", "coupling/", "cases/", "tests/"];
/// Ends by which a word that begins so is a file, also outside of backticks.
const ENDS: [&str; 6] = [".rs", ".py", ".md", ".toml", ".csv", ".png"];
/// Files that nobody wrote by hand.
const GENERATED: [&str; 3] = ["lock", "csv", "png"];
/// Folders and files that programs leave (see .gitignore).
const LEFT: [&str; 5] = [".git", "target", "out", ".venv", "__pycache__"];
/// Ends by which a word in backticks on a page is a file, wherever it lies.
const SOURCES: [&str; 4] = [".rs", ".py", ".toml", ".csv"];
/// Files that programs write, and those of a user's that pages speak of.
const WRITTEN: [&str; 19] = [
    "series.csv",
    "stability.csv",
    "verification.csv",
    "validation.csv",
    "curves.csv",
    "measured.csv",
    "results.csv",
    "averages.csv",
    "analysis.csv",
    "spectra.csv",
    "spectrum.csv",
    "bed.csv",
    "bubbles.csv",
    "bubbles-by-height.csv",
    "profiles.csv",
    "packing-0.csv",
    "bed.toml",
    "mybed.toml",
    "slump.toml",
];
/// Pages that lie outside of this repository. In two parts, as this file is read too.
const OUTSIDE: [[&str; 2]; 4] =
    [["physics", ".md"], ["droplet", ".md"], ["../", "shared"], ["reference/", "manufactured.py"]];

/// The files of the repository and the folders they lie in, with `/` between.
struct Files(BTreeSet<String>);

impl Files {
    fn new(files: &[String]) -> Self {
        let paths = files.iter().flat_map(|file| Path::new(file).ancestors());
        Self(paths.filter(|path| *path != Path::new("")).map(slashed).collect())
    }

    /// Whether a path leads to something, from the top or from the package that `page` is in.
    fn has(&self, path: &str, page: &str) -> bool {
        let package = page.split('/').next().unwrap_or_default();
        self.0.contains(path) || self.0.contains(&format!("{package}/{path}"))
    }

    /// Whether there is a file that ends in this path, or that a page may speak of though it is not there.
    fn somewhere(&self, path: &str, page: &str) -> bool {
        let end = format!("/{path}");
        let written = WRITTEN.contains(&path);
        written
            || self.has(&resolve(page, path), "")
            || self.0.iter().any(|file| file == path || file.ends_with(&end))
    }
}

fn slashed(path: &Path) -> String {
    path.to_string_lossy().replace('\\', "/")
}

/// What git knows, and what it would take; all files where there is no git.
fn files(root: &Path) -> Vec<String> {
    let options = ["ls-files", "--cached", "--others", "--exclude-standard", "-z"];
    let listed = Command::new("git").args(options).current_dir(root).output();
    let known: Vec<String> = match listed {
        Ok(listed) if root.join(".git").exists() && listed.status.success() => {
            String::from_utf8_lossy(&listed.stdout).split_terminator('\0').map(String::from).collect()
        }
        _ => {
            let mut found = vec![];
            walk(root, Path::new(""), &mut found);
            found
        }
    };
    // Git lists what was removed but not yet committed too.
    known.into_iter().filter(|file| root.join(file).is_file()).collect()
}

fn walk(root: &Path, folder: &Path, found: &mut Vec<String>) {
    for entry in fs::read_dir(root.join(folder)).expect("a folder").flatten() {
        let (name, path) = (entry.file_name(), folder.join(entry.file_name()));
        if LEFT.iter().any(|left| name == *left) || path.extension() == Some(OsStr::new("so")) {
            continue;
        }
        match entry.file_type() {
            Ok(kind) if kind.is_dir() => walk(root, &path, found),
            _ => found.push(slashed(&path)),
        }
    }
}

/// Targets of the links and pictures of a line of Markdown, without the place on the page.
fn linked(line: &str) -> impl Iterator<Item = &str> {
    let targets = line.split("](").skip(1).filter_map(|rest| rest.split([')', ' ', '#']).next());
    let pictures = line.split("src=\"").skip(1).filter_map(|rest| rest.split('"').next());
    targets.chain(pictures).filter(|target| !target.is_empty() && !target.contains(':'))
}

/// The files that a page shows: blocks whose first line is a comment with a name, `# NAME.py`.
fn shown(text: &str) -> BTreeSet<&str> {
    let names = text.split("\n```").filter_map(|block| block.lines().nth(1)?.strip_prefix("# "));
    names.filter(|name| !name.contains(' ')).collect()
}

/// Words in backticks that are files of the repository by their end: not patterns, not with something to be filled in.
fn sources(text: &str) -> impl Iterator<Item = &str> {
    let part = |c: char| c.is_ascii_alphanumeric() || "_-./*<>{}$".contains(c);
    let words = text.split(move |c| !part(c)).filter(|word| SOURCES.iter().any(|end| word.ends_with(end)));
    // A key such as `grains.placement.csv` is no file.
    let key = |word: &str| !word.contains('/') && word.matches('.').count() > 1;
    let whole = move |word: &&str| {
        !word.contains(['*', '<', '>', '{', '}', '$']) && !SOURCES.contains(word) && !key(word)
    };
    words.filter(whole).filter(|word| !word.split('/').any(|name| name == "out" || placeholder(name)))
}

/// Words that may be paths of this repository: not patterns, not with something to be filled in, not what runs leave.
fn words(text: &str) -> impl Iterator<Item = &str> {
    let part = |c: char| c.is_ascii_alphanumeric() || "_-./*<>{}$".contains(c);
    let words = text.split(move |c| !part(c)).filter(|word| TOPS.iter().any(|top| word.starts_with(top)));
    let whole = |word: &&str| !word.contains("..") && !word.contains(['*', '<', '>', '{', '}', '$']);
    let given = |word: &&str| !word.split('/').any(|name| name == "out" || placeholder(name));
    words.filter(whole).filter(given).map(|word| word.trim_end_matches(['.', '/']))
}

/// Whether a name is to be filled in: NAME.toml.
fn placeholder(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or_default();
    let any = |of: fn(&u8) -> bool| stem.bytes().any(|c| of(&c));
    any(u8::is_ascii_uppercase) && !any(u8::is_ascii_lowercase) && stem != "README"
}

/// The folder of a page and a relative path from there, without `..`.
fn resolve(page: &str, target: &str) -> String {
    let mut path = PathBuf::from(page);
    path.pop();
    for part in Path::new(target).components() {
        match part {
            Component::ParentDir => drop(path.pop()),
            Component::Normal(name) => path.push(name),
            _ => {}
        }
    }
    slashed(&path)
}

/// What a page names that is not there, with the numbers of the lines: in backticks, single or double, anything;
/// elsewhere files; in Markdown links and pictures too.
fn wrong(page: &str, text: &str, files: &Files) -> Vec<String> {
    let mut wrong = vec![];
    let shown = shown(text);
    for (number, line) in text.lines().enumerate() {
        let single = line.replace("``", "`");
        let quoted = single.split('`').skip(1).step_by(2).flat_map(words);
        let plain = words(line).filter(|word| ENDS.iter().any(|end| word.ends_with(end)));
        let missing = quoted.chain(plain).filter(|word| !files.has(word, page));
        let mut found: BTreeSet<String> = missing.map(String::from).collect();
        if page.ends_with(".md") {
            found.extend(linked(line).filter(|to| !files.has(&resolve(page, to), "")).map(String::from));
            let quoted = single.split('`').skip(1).step_by(2).flat_map(sources);
            let missing = quoted.filter(|file| !shown.contains(file) && !files.somewhere(file, page));
            found.extend(missing.map(String::from));
        }
        found.extend(OUTSIDE.map(|parts| parts.concat()).into_iter().filter(|name| line.contains(name)));
        wrong.extend(found.into_iter().map(|name| format!("{page}:{}: `{name}` is not there", number + 1)));
    }
    wrong
}

#[test]
fn files_that_are_named_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a folder above the tests");
    let all = files(root);
    let known = Files::new(&all);
    assert!(known.has("coupling/src/lib.rs", "") && known.has("tests/verification", ""));
    let written = |page: &&String| {
        !Path::new(page).extension().is_some_and(|end| GENERATED.iter().any(|other| end == *other))
    };
    let mut missing = vec![];
    for page in all.iter().filter(written) {
        // What is no text names nothing.
        let Ok(text) = fs::read_to_string(root.join(page)) else { continue };
        missing.extend(wrong(page, &text, &known));
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

#[test]
fn a_wrong_reference_is_found_and_what_is_none_is_not() {
    // With | for /, as this file is read too.
    let path = |text: &str| text.replace('|', "/");
    let there = ["dem|src|lib.rs", "tests|cases|bed.toml", "cases|hopper|README.md", "cases|hopper|a-1.png"];
    let known = Files::new(&there.map(path));
    let page = path("cases|hopper|README.md");
    for line in [
        "the law (`dem|src|lib.rs`), a folder (`dem|src|`), a command `run tests|cases|bed.toml --quiet`",
        "plain, tests|cases|bed.toml, and one at the end: tests|cases|bed.toml.",
        "from the package: `hopper`, `cases|hopper`; \"dem|..\", dem|fluid ratios",
        "patterns and placeholders: `cases|*.toml`, `cases|<name>.rs`, `cases|{a,b}.rs`, `cases|NAME.toml`",
        "what a run leaves: `cases|out|series.csv`, `series.csv`",
        "![a picture](a-1.png), [a page](..|hopper|README.md#here), [a place](#here), [far](https:||a.b|c.md)",
        "<img src=\"a-1.png\">, `lib.rs`, `src|lib.rs`, `..|..|tests|cases|bed.toml`, `.toml`",
        "what runs write and what is no file: `series.csv`, `NAME.toml`, `scene*.toml`, `[grains.placement.csv]`",
    ] {
        assert_eq!(wrong(&page, &path(line), &known), Vec::<String>::new(), "{line}");
    }
    let with_file = "\n```python\n# own.py\nimport voidage\n```\n`voidage run --scheme python:own.py`";
    assert_eq!(wrong(&page, with_file, &known), Vec::<String>::new());
    let in_package = path("the scene cases|bed.toml of this package");
    assert_eq!(wrong(&path("tests|lib.rs"), &in_package, &known), Vec::<String>::new());
    let [pages, .., shared, _] = OUTSIDE.map(|parts| parts.concat());
    for (line, name) in [
        (path("the law (`dem|src|law.rs`)"), path("dem|src|law.rs")),
        (path("`a` and ``dem|gone`` in Python"), path("dem|gone")),
        (path("in a string: dem|src|law.rs, say"), path("dem|src|law.rs")),
        (path("a page of a case, `cases|bed|README.md`"), path("cases|bed|README.md")),
        (path("![a picture](a-2.png)"), path("a-2.png")),
        (path("<img src=\"a-3.png\" width=\"200\">"), path("a-3.png")),
        (path("the file `law.rs`"), path("law.rs")),
        (path("`python3 tools|law.py --now`"), path("tools|law.py")),
        (path("`..|gone.csv`"), path("..|gone.csv")),
        (path("[a page](..|hopper.md#here)"), path("..|hopper.md")),
        (format!("section 7 of {pages}"), pages),
        (format!("see {shared}/notes"), shared),
    ] {
        let found = wrong(&page, &format!("fine\n{line}"), &known);
        assert_eq!(found, [format!("{page}:2: `{name}` is not there")]);
    }
}
