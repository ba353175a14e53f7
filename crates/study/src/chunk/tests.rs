use super::*;

/// A study of seven items, in a folder with its three chunks.
struct Site {
    folder: tempfile::TempDir,
    whole: Whole,
    chunks: Vec<PathBuf>,
}

const ITEMS: [f64; 7] = [0.1, 1.0 / 3.0, 1e-300, -0.0, 5e-324, 1.797e308, 2.5];

impl Site {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let whole = whole("study", "--seed 1");
        let mut site = Self { folder, whole, chunks: Vec::new() };
        site.chunks = ["1/3", "2/3", "3/3"].map(|chunk| site.write(chunk, ITEMS)).to_vec();
        site
    }

    fn write(&self, chunk: &str, items: [f64; 7]) -> PathBuf {
        self.write_of(&self.whole, chunk, items)
    }

    fn write_of(&self, whole: &Whole, chunk: &str, items: [f64; 7]) -> PathBuf {
        let chunk: ChunkNumber = chunk.parse().unwrap();
        let folder = Folder::at(self.folder.path()).unwrap();
        whole.write(&folder, chunk, chunk.of(items).collect()).unwrap()
    }

    fn merge(&self, chunks: &[usize]) -> Result<Vec<f64>, String> {
        let paths: Vec<_> = chunks.iter().map(|chunk| self.chunks[*chunk].clone()).collect();
        self.merge_paths(&paths)
    }

    fn merge_paths(&self, paths: &[PathBuf]) -> Result<Vec<f64>, String> {
        self.whole.merge(paths, ITEMS.len()).map_err(|error| rig_model::with_causes(&error))
    }

    #[track_caller]
    fn refuses(&self, paths: &[PathBuf], parts: &[&str]) {
        let message = self.merge_paths(paths).unwrap_err();
        for part in parts {
            assert!(message.contains(part), "{part} is not in\n{message}");
        }
    }
}

fn whole(study: &str, arguments: &str) -> Whole {
    Whole::new(study, arguments.to_owned()).unwrap()
}

fn bits(items: &[f64]) -> Vec<u64> {
    items.iter().map(|item| item.to_bits()).collect()
}

#[test]
fn chunks_in_any_order_and_as_often_as_you_like_are_the_whole_to_the_last_bit() {
    let site = Site::new();
    for chunks in [&[0, 1, 2][..], &[2, 0, 1], &[1, 1, 2, 0, 1]] {
        assert_eq!(bits(&site.merge(chunks).unwrap()), bits(&ITEMS), "{chunks:?}");
    }
    // More chunks than items.
    let many: Vec<_> =
        (1..=9).map(|number| site.write(&format!("{number}/9"), ITEMS)).rev().collect();
    assert_eq!(bits(&site.merge_paths(&many).unwrap()), bits(&ITEMS));
    let names = fs::read_dir(site.folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(names.into_iter().all(|name| name.to_string_lossy().ends_with(".json")));
}

#[test]
fn a_chunk_is_written_again_as_the_same_bytes() {
    let site = Site::new();
    let before = fs::read(&site.chunks[1]).unwrap();
    assert_eq!(site.write("2/3", ITEMS), site.chunks[1]);
    assert_eq!(fs::read(&site.chunks[1]).unwrap(), before);
}

#[test]
fn chunks_that_are_missing_are_named() {
    let site = Site::new();
    site.refuses(&site.chunks[1..2], &["of 3 chunks these are missing: 1, 3"]);
    let nowhere = site.folder.path().join("nowhere.json");
    site.refuses(&[site.chunks[0].clone(), nowhere], &["nowhere.json"]);
}

#[test]
fn a_chunk_of_something_else_is_refused_by_name() {
    let site = Site::new();
    let with = |other: PathBuf| vec![site.chunks[0].clone(), other, site.chunks[2].clone()];
    let other = site.write_of(&whole("other", "--seed 1"), "2/3", ITEMS);
    site.refuses(&with(other), &["other-2-of-3.json is a chunk of `other`", "`study`"]);
    let program = Whole { program: "0".repeat(16), ..site.whole.clone() };
    let other = site.write_of(&program, "2/3", ITEMS);
    site.refuses(&with(other), &["computed by the program 0000000000000000", "copies of one file"]);
    let other = site.write_of(&whole("study", "--seed 2"), "2/3", ITEMS);
    site.refuses(&with(other), &["the arguments \"--seed 2\"", "\"--seed 1\""]);
    let other = site.write("2/4", ITEMS);
    site.refuses(&with(other), &["study-2-of-4.json is one of 4 chunks, and others are of 3"]);
    let folder = Folder::at(site.folder.path()).unwrap();
    let short = site.whole.write(&folder, "2/3".parse().unwrap(), vec![0.0]).unwrap();
    site.refuses(&with(short), &["has 1 results, and this chunk has 2"]);
}

#[test]
fn an_altered_chunk_is_refused_wherever_it_was_altered() {
    let site = Site::new();
    let path = &site.chunks[1];
    let text = fs::read_to_string(path).unwrap();
    for (from, to) in [
        ("0.3333333333333333", "0.3333333333333334"),
        ("\"number\":2", "\"number\":1"),
        ("--seed 1", "--seed 2"),
        ("\"software\":\"rigd", "\"software\":\"rig"),
    ] {
        let altered = text.replace(from, to);
        assert_ne!(altered, text, "{from}");
        fs::write(path, altered).unwrap();
        site.refuses(&site.chunks, &["study-2-of-3.json was altered"]);
    }
    for wrong in ["", "{}", &text[..text.len() / 2], &text.replace("results", "rows")] {
        fs::write(path, wrong).unwrap();
        site.refuses(&site.chunks, &["study-2-of-3.json is not a chunk of `rig-study study`"]);
    }
}

#[test]
fn one_chunk_with_two_results_is_refused() {
    let site = Site::new();
    let other = site.folder.path().join("kept.json");
    fs::copy(&site.chunks[1], &other).unwrap();
    site.write("2/3", ITEMS.map(|item| item + 1.0));
    let mut paths = site.chunks.clone();
    paths.push(other);
    site.refuses(&paths, &["chunk 2 is there twice", "study-2-of-3.json", "kept.json"]);
}

#[test]
fn a_number_of_a_chunk_is_within_their_number() {
    let read = |text: &str| text.parse::<ChunkNumber>();
    assert_eq!(read("3/8").unwrap(), ChunkNumber { number: 3, of: 8 });
    for wrong in ["", "3", "0/8", "9/8", "1/0", "1/", "/1", "-1/2", "1/2/3", "a/b"] {
        assert!(read(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn a_queue_goes_with_its_own_options_alone() {
    #[derive(Debug, clap::Parser)]
    struct Cli {
        #[command(flatten)]
        chunks: ChunkArgs,
    }
    let accepts = |words: &str| {
        <Cli as clap::Parser>::try_parse_from(["study"].into_iter().chain(words.split(' '))).is_ok()
    };
    for words in [
        "--queue nats://host --fill --chunks 5 --silent-s 5 --deliveries 2",
        "--queue nats://host --worker --chunks 5 --within-s 5 --queue-files directory",
        "--queue nats://host --gather --within-s 0",
    ] {
        assert!(accepts(words), "{words}");
    }
    for words in [
        "--queue nats://host",
        "--queue nats://host --fill --gather",
        "--queue nats://host --fill --chunks 0",
        "--queue nats://host --fill --chunks 100001",
        "--queue nats://host --worker --silent-s 5",
        "--queue nats://host --worker --chunk 1/2",
        "--queue nats://host --gather --merge one.json",
        "--chunks 5",
        "--fill",
    ] {
        assert!(!accepts(words), "{words}");
    }
}

#[test]
fn works_of_a_queue_differ_as_their_results_do() {
    let site = Site::new();
    let content = |whole: &Whole, chunks| whole.work(chunks).unwrap().content;
    let own = content(&site.whole, 3);
    assert_eq!(own, content(&site.whole, 3));
    let program = Whole { program: "0".repeat(16), ..site.whole.clone() };
    assert_eq!(own, content(&program, 3));
    assert_eq!(program.work(3).unwrap().program, program.program);
    for (whole, chunks) in
        [(&site.whole, 4), (&whole("study", "--seed 2"), 3), (&whole("other", "--seed 1"), 3)]
    {
        assert_ne!(own, content(whole, chunks), "{whole:?} {chunks}");
    }
}
