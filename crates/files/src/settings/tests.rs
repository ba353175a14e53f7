//! The faults of a file, as a person reads them.

use super::{InForce, Setting, Table, in_force, read};
use crate::{Complaint, Faults};

/// A file with every kind of value.
#[derive(Debug)]
struct Touch {
    name: String,
    angles_deg: Setting<Vec<Setting<f64>>>,
    window: (f64, f64),
    points: Vec<(String, u32)>,
    seed: Option<u64>,
    order: char,
    is_blind: bool,
    speed_mm_per_s: f64,
}

fn touch(table: &mut Table<'_>) -> Touch {
    Touch {
        name: table.text("name").required().value,
        angles_deg: table.number("angles_deg").range(0.0..=45.0).list().required(),
        window: table.section("window", window).required().value,
        points: table
            .section("points", point)
            .list()
            .optional()
            .map(|points| points.value.into_iter().map(|point| point.value).collect())
            .unwrap_or_default(),
        seed: table.whole("seed").optional().map(|seed| seed.value),
        order: table.choice("order", [("listed", 'l'), ("random", 'r')]).or('l').value,
        is_blind: table.flag("is_blind").or(false).value,
        speed_mm_per_s: table.number("speed_mm_per_s").above(0.0).at_most(20.0).or(1.0).value,
    }
}

#[derive(Debug, thiserror::Error)]
#[error("max_hz = {max} is not above min_hz = {min}")]
struct EmptyWindow {
    min: f64,
    max: f64,
}

impl Complaint for EmptyWindow {}

fn window(table: &mut Table<'_>) -> (f64, f64) {
    let min = table.number("min_hz").above(0.0).required();
    let max = table.number("max_hz").above(0.0).required();
    if let (Some(&min), Some(&max_hz)) = (min.sound(), max.sound())
        && max_hz <= min
    {
        table.refuse(&max, &EmptyWindow { min, max: max_hz });
    }
    (min.value, max.value)
}

fn point(table: &mut Table<'_>) -> (String, u32) {
    let name = table.text("name").required().value;
    (name, table.count("cycles").range(1..=100).required().value)
}

#[track_caller]
fn faults(text: &str) -> Faults {
    read("touch.toml", text, touch).1
}

const GOOD: &str = r#"
name = "five soft samples"
angles_deg = [0, 15, 3e1, 45.0]
seed = 0xFF
order = "random"
is_blind = true
speed_mm_per_s = 0.5
window = { min_hz = 125, max_hz = 1_60.5 }
[[points]]
name = "µ"
cycles = 10
"#;

#[test]
fn a_good_file_is_read() {
    let (touch, faults) = read("touch.toml", GOOD, touch);
    let touch = faults.finish(touch).unwrap();
    assert_eq!(touch.name, "five soft samples");
    let angles: Vec<_> = touch.angles_deg.value.iter().map(|angle| angle.value).collect();
    assert_eq!(angles, [0.0, 15.0, 30.0, 45.0]);
    assert_eq!(touch.window, (125.0, 160.5));
    assert_eq!(touch.points, [("µ".to_owned(), 10)]);
    assert_eq!((touch.seed, touch.order, touch.is_blind), (Some(255), 'r', true));
    assert_eq!(touch.speed_mm_per_s, 0.5);
}

#[test]
fn every_value_has_its_location() {
    let (touch, _) = read("touch.toml", GOOD, touch);
    let location = |setting: &Setting<f64>| (setting.location.line, setting.location.column);
    let locations: Vec<_> = touch.angles_deg.value.iter().map(location).collect();
    assert_eq!(locations, [(3, 15), (3, 18), (3, 22), (3, 27)]);
    assert_eq!(touch.angles_deg.value[2].to_string(), "30 in angles_deg");
}

#[test]
fn optional_keys_may_be_left_out() {
    let text = "name = \"a\"\nangles_deg = [0]\n[window]\nmin_hz = 1\nmax_hz = 2\n";
    assert_eq!(faults(text).to_string(), "");
}

#[test]
fn ten_faults_give_ten_messages() {
    let text = r#"
nam = "µ"
angles_deg = [0, 15, "30", 50]
order = "randm"
is_blind = 1
seed = -3
speed_mm_per_s = 0
depth = 7

[window]
min_hz = 200
max_hz = 100
cycles = 4

[[points]]
name = 3
"#;
    insta::assert_snapshot!(faults(text));
}

#[test]
fn every_kind_of_value_is_refused_where_another_is_expected() {
    let text = r#"
name = ["a"]
angles_deg = 30
order = { random = true }
is_blind = "yes"
seed = 1.5
speed_mm_per_s = inf
window = [1, 2]
points = "none"
"#;
    insta::assert_snapshot!(faults(text));
}

#[test]
fn a_key_in_the_wrong_table_is_sent_home_and_not_missed_there() {
    let text = "angles_deg = [0]\n[window]\nmin_hz = 1\nmax_hz = 2\nname = \"a\"\n";
    insta::assert_snapshot!(
        faults(text),
        @"touch.toml:5:1: `name` is not a key in [window]; it belongs at the top of the file"
    );
}

#[test]
fn an_interval_is_two_rising_numbers() {
    #[track_caller]
    fn check(written: &str, expected: Result<(f64, f64), &str>) {
        let reader = |table: &mut Table<'_>| {
            table.number("travel_mm").range(-9.0..=9.0).interval().required().value
        };
        let (interval, faults) = read("x", &format!("travel_mm = {written}"), reader);
        let found = faults.finish(interval).map_err(|faults| faults.to_string());
        assert_eq!(found, expected.map_err(|message| format!("x:1:{message}")));
    }
    check("[-1, 2.5]", Ok((-1.0, 2.5)));
    let rising = "13: travel_mm is not two rising numbers; put the smaller one first";
    check("[2, 2]", Err("13: travel_mm is not two rising numbers; give two different numbers"));
    check("[2, 1]", Err(rising));
    let two = "13: travel_mm is not two rising numbers; give the lowest and the highest value";
    check("[2]", Err(two));
    check("[1, 2, 3]", Err(two));
    check("[1, 10]", Err("17: 10 in travel_mm is above the limit of 9 mm; use at most 9"));
    check("2", Err("13: travel_mm = 2 must be a list, not a whole number; write [2]"));
}

#[test]
fn text_is_one_line_and_lists_are_not_endless() {
    #[track_caller]
    fn check(line: &str, expected: &str) {
        let reader = |table: &mut Table<'_>| {
            table.text("name").max_chars(4).optional();
            table.number("angles_deg").list().at_most(3).optional();
        };
        assert_eq!(read("x", line, reader).1.to_string(), expected);
    }
    check("name = \"abcd\"", "");
    check(
        "name = \"abcde\"",
        "x:1:8: name = \"abcde\" has 5 characters, above the limit of 4; shorten it",
    );
    check("name = \"  \"", "x:1:8: name = \"  \" is empty");
    check(
        "name = \"a\\nb\"",
        "x:1:8: name = \"a\\nb\" has the control character U+000A; keep it in one line",
    );
    check("angles_deg = [0, 1, 2]", "");
    check(
        "angles_deg = [0, 1, 2, 3]",
        "x:1:14: angles_deg has 4 entries, above the limit of 3; leave some out",
    );
}

#[test]
fn a_quotation_in_a_message_is_one_short_line() {
    let long = "x".repeat(1000);
    let text = format!("name = {long:?}\norder = \"\"\"a\nb\"\"\"\n\"a\\nb\" = 1\n{long} = 2\n");
    let messages: Vec<_> = faults(&text).iter().map(ToString::to_string).collect();
    assert!(messages.iter().all(|message| !message.contains('\n')), "{messages:#?}");
    let longest = messages.iter().map(|message| message.chars().count()).max();
    assert!(longest < Some(250), "{messages:#?}");
}

#[test]
fn a_missing_table_is_one_fault() {
    insta::assert_snapshot!(
        faults("name = \"a\"\nangles_deg = []"),
        @r"
    touch.toml:1:1: `window` is missing at the top of the file
    touch.toml:2:14: angles_deg is an empty list; give at least one, or leave the key out
    "
    );
}

#[test]
fn a_misspelt_key_in_one_of_a_list_does_not_excuse_another() {
    let text = r#"
name = "a"
angles_deg = [0]
window = { min_hz = 1, max_hz = 2 }
[[points]]
nam = "b"
cycles = 1
[[points]]
cycles = 1
"#;
    insta::assert_snapshot!(faults(text));
}

#[test]
fn faulty_syntax_hides_only_its_own_lines() {
    let text = r#"
name = "a
angles_deg = [0, 50]
speed_mm_per_s = 0,5
order = listed
seed = 1
seed = 2
is_blind true
[window]
min_hz = 1.2.3
max_hz = 0
"#;
    insta::assert_snapshot!(faults(text));
}

#[test]
fn a_broken_header_is_one_fault() {
    let text = "name = \"a\"\nangles_deg = [0]\n[window\nmin_hz = 1\nmax_hz = 2\n";
    insta::assert_snapshot!(
        faults(text),
        @"touch.toml:3:8: not TOML: unclosed table, expected `]`"
    );
}

#[test]
fn any_cut_of_a_file_is_refused_or_read_without_a_panic() {
    for end in (0..GOOD.len()).filter(|&end| GOOD.is_char_boundary(end)) {
        let (_, faults) = read("touch.toml", &GOOD[..end], touch);
        for fault in &faults {
            assert!(fault.location.line <= 12 && fault.location.column <= 43, "{fault}");
        }
    }
}

#[test]
fn faults_stay_in_the_order_of_the_lines_when_a_later_check_adds_one() {
    let (touch, mut faults) = read("touch.toml", GOOD, touch);
    let complaint = |_: &f64| Some(EmptyWindow { min: 0.0, max: 0.0 });
    touch.angles_deg.value[3].check(&mut faults, complaint);
    touch.angles_deg.value[0].check(&mut faults, complaint);
    let columns: Vec<_> = faults.iter().map(|fault| fault.location.column).collect();
    assert_eq!(columns, [15, 27]);
}

#[test]
fn values_in_force_have_their_place_also_those_that_the_file_leaves_out() {
    fn file(table: &mut Table<'_>) {
        table.text("name").required();
        table.number("angles_deg").list().required();
        table.number("speed").or(1.5);
        table.choice("order", [("listed", 'l'), ("random", 'r')]).or('r');
        table.whole("seed").optional();
        table.section("sweep", |table| _ = table.number("low_hz").interval().or((1.0, 2.0))).or(());
        table.section("unused", |table| _ = table.flag("is_used").or(true)).optional();
        let sample = |table: &mut Table<'_>| {
            table.text("label").required();
            table.flag("is_blind").or(false);
        };
        table.section("samples", sample).list().or(Vec::new());
    }
    let text = "angles_deg = [0,\n  15]\nname = \"a\"\n[[samples]]\nlabel = \"x\"\n[[samples]]\n\
                is_blind = true\nlabel = \"y\"\n";
    let ((), faults, values) = in_force("f.toml", text, file);
    assert!(faults.is_empty(), "{faults}");
    let shown = |value: InForce| {
        let text = value.text.unwrap_or_else(|| "not given".to_owned());
        let line = value.location.map_or("default".to_owned(), |at| format!("line {}", at.line));
        format!("{} = {text}, {line}", value.name)
    };
    let shown: Vec<_> = values.into_iter().map(shown).collect();
    let expected = [
        "name = \"a\", line 3",
        "angles_deg = [0, 15], line 1",
        "speed = 1.5, default",
        "order = \"random\", default",
        "seed = not given, default",
        "sweep.low_hz = [1, 2], default",
        "samples[0].label = \"x\", line 5",
        "samples[0].is_blind = false, default",
        "samples[1].label = \"y\", line 8",
        "samples[1].is_blind = true, line 7",
    ];
    assert_eq!(shown, expected);
    // A list of tables that is left out.
    let (.., values) = in_force("f.toml", "name = \"a\"\nangles_deg = [0]\n", file);
    let last = values.last().unwrap();
    assert_eq!((last.name.as_str(), last.text.as_deref()), ("samples", Some("[]")));
}

#[test]
fn a_file_full_of_faults_gives_the_first_of_them_and_the_number_of_the_others() {
    let keys = (0..1000).map(|n| format!("k{n} = 1\n")).collect::<Vec<_>>().concat();
    let ((), faults) = read("a.toml", &keys, |_| ());
    let said: Vec<_> = faults.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 51);
    assert!(said[49].starts_with("a.toml:50:1: `k49` is not a key"), "{said:?}");
    assert_eq!(
        said[50],
        "a.toml:51:1: the file has 950 more faults from here on; correct these first"
    );
}
