use std::fs;

use clap::Parser;

use super::*;

#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    args: Args,
}

fn args(folder: &Path, words: &[&str]) -> Args {
    let (out, rows) = (folder.to_str().unwrap(), folder.join("rows.csv"));
    let grid = ["design", "--length-mm", "20:50:4", "--radius-mm", "0.2:1:3", "--out", out];
    let of_rows = ["--rows", rows.to_str().unwrap()];
    let words = grid.iter().chain(&of_rows).chain(words);
    Cli::try_parse_from(words).unwrap().args
}

#[test]
fn the_page_of_chunks_has_the_bytes_of_that_of_one_process() {
    let [alone, parts, merged] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    run(&args(alone.path(), &[]), &mut Vec::new()).unwrap();
    for chunk in ["1/3", "2/3", "3/3"] {
        run(&args(parts.path(), &["--chunk", chunk]), &mut Vec::new()).unwrap();
    }
    let paths = [3, 1, 2, 1].map(|number| parts.path().join(format!("design-{number}-of-3.json")));
    let paths = paths.each_ref().map(|path| path.to_str().unwrap());
    // What was there of another grid makes no difference.
    fs::write(merged.path().join("rows.csv"), "of another grid\n").unwrap();
    let merge = args(merged.path(), &[&["--merge"], &paths[..]].concat());
    run(&merge, &mut Vec::new()).unwrap();
    let files = ["design.md", "design.html", "rows.csv", "front.csv"];
    for file in files {
        let [one, other] =
            [&alone, &merged].map(|folder| fs::read(folder.path().join(file)).unwrap());
        assert!(one == other, "{file}");
    }
    let charts = fs::read_dir(alone.path().join("design")).unwrap();
    for chart in charts.map(|entry| entry.unwrap().path()) {
        let other = merged.path().join("design").join(chart.file_name().unwrap());
        assert!(fs::read(&chart).unwrap() == fs::read(other).unwrap(), "{chart:?}");
    }

    let wrong = Args { stage: true, ..merge };
    let message = rig_model::with_causes(&run(&wrong, &mut Vec::new()).unwrap_err());
    assert!(message.contains("20:50:4") && message.contains("was computed with"), "{message}");
}
