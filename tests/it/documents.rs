//! The documents name files that exist.

use std::{
    fs,
    path::{Path, PathBuf},
};

use rig_tests::shipped;

/// Every file with this extension below a folder, without build output.
fn files(folder: &Path, ending: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let (path, name) = (entry.path(), entry.file_name());
        let is_hidden = name.as_encoded_bytes().starts_with(b".");
        if entry.file_type().unwrap().is_dir() {
            if !is_hidden && name != "target" && name != "node_modules" {
                files(&path, ending, found);
            }
        } else if path.extension().is_some_and(|extension| extension == ending) {
            found.push(path);
        }
    }
}

/// The targets of the links of a page that lead to files.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let targets = targets.map(|target| target.split('#').next().unwrap_or_default());
    targets.filter(|target| !target.is_empty() && !target.contains("://"))
}

/// The paths of sources that a page names between backticks.
fn paths(text: &str) -> impl Iterator<Item = &str> {
    let is_path = |word: &&str| {
        ["crates/", "rig-sim/", "tests/", "config/", "docs/"]
            .iter()
            .any(|top| word.starts_with(top))
            && !word.contains([' ', '*', '<', '{', '\n'])
    };
    text.split('`').skip(1).step_by(2).filter(is_path)
}

#[test]
fn every_link_and_path_in_a_document_exists() {
    let root = shipped("");
    let mut pages = Vec::new();
    files(&root, "md", &mut pages);
    assert!(pages.iter().any(|page| page.ends_with("docs/architecture.md")), "{pages:?}");
    let mut missing = Vec::new();
    for page in pages {
        let text = fs::read_to_string(&page).unwrap();
        let folder = page.parent().unwrap();
        let links = links(&text).map(|link| (link, folder.join(link)));
        let paths = paths(&text).map(|path| (path, root.join(path)));
        let lost = links.chain(paths).filter(|(_, target)| !target.exists());
        missing.extend(lost.map(|(name, _)| format!("{}: {name}", page.display())));
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}
