//! The results of a complete, a refused, a faulted and an empty run.

mod aim;
mod amended;
mod marks;
pub(crate) mod sample;
mod shared;

use std::{collections::BTreeMap, sync::Arc};

use rig_record::{Chain, ChainCheck, Flaw, StoredRecord};

use super::*;
use sample::{SampleRun, Story};

fn rendered(story: Story) -> String {
    SampleRun::new(story).html()
}

/// The text of an element with this opening tag.
#[track_caller]
fn inside<'a>(html: &'a str, open: &str, close: &str) -> &'a str {
    let start = html.find(open).unwrap_or_else(|| panic!("no {open}")) + open.len();
    &html[start..start + html[start..].find(close).unwrap()]
}

/// Every tag is closed in its order, and no id is given twice.
#[track_caller]
fn check_markup(html: &str) {
    let (mut open, mut ids) = (Vec::new(), Vec::new());
    for piece in html.split('<').skip(1) {
        let tag = piece.split('>').next().unwrap();
        let name = tag.split([' ', '/']).find(|word| !word.is_empty()).unwrap();
        if let Some(id) = tag.split(" id=\"").nth(1) {
            ids.push(id.split('"').next().unwrap());
        }
        match tag {
            _ if tag.starts_with('/') => assert_eq!(open.pop(), Some(name), "near <{piece}"),
            _ if tag.ends_with('/') || ["!DOCTYPE", "meta", "br"].contains(&name) => {}
            _ => open.push(name),
        }
    }
    assert_eq!(open, [""; 0]);
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count, "an id is given twice");
}

#[test]
fn every_report_is_one_well_formed_file_without_requests() {
    for story in [Story::Complete, Story::Refused, Story::Faulted, Story::Empty] {
        let html = rendered(story);
        check_markup(&html);
        let foreign = html.replace("http://www.w3.org/2000/svg", "");
        for call in ["http:", "https:", "src=", "href=", "<script", "@import", "url(http"] {
            assert!(!foreign.contains(call), "{story:?}: {call}");
        }
        assert!(!html.contains("NaN"), "{story:?}");
        assert!(!html.contains("chart:"), "{story:?}: a chart could not be drawn");
    }
}

#[test]
fn a_complete_run_has_every_figure() {
    let html = rendered(Story::Complete);
    let figures = [
        "samples",
        "samples-narrow",
        "front",
        "back",
        "left",
        "mean",
        "mean-narrow",
        "residual-front",
        "residual-back",
        "residual-left",
        "stiffness",
        "blind-stiffness",
        "blind",
        "blind-narrow",
        "no-load",
        "no-load-narrow",
        "budget",
        "size",
        "phase",
    ];
    for figure in figures {
        assert!(html.contains(&format!("<title id=\"fig-{figure}-t\">")), "{figure}");
    }
    // The others are the small pictures, one for each touch.
    let small = inside(&html, "<div class=\"multiples\">", "</div>").matches("<svg ").count();
    assert_eq!((html.matches("<svg ").count() - small, small), (figures.len(), 110));
    for number in ["Figure 11. ", "Figure 12. ", "Figure 13. ", "46 of 50: 92 %", "134.11 Hz/MPa"] {
        assert!(html.contains(number), "{number}");
    }
    assert!(!html.contains("What happened"));
    let stiffness = html.find("Young's modulus of the samples").unwrap();
    assert!(stiffness < html.find("<figure>").unwrap(), "the stiffness is not at the top");
    assert!(html.contains("<summary>Protocol “three-direction”</summary>"));
}

#[test]
fn as_many_touches_are_ringed_as_are_wrong() {
    let sample = SampleRun::new(Story::Complete);
    let html = sample.html();
    let found = sample.results().summary();
    let blind = found.classification.unwrap();
    assert!(0 < blind.correct && blind.correct < blind.trials, "nothing to be seen: {blind:?}");
    let figure = inside(&html, "<title id=\"fig-blind-t\">", "</svg>");
    let rings = figure.matches("class=\"open s6\"").count();
    // One is in the legend.
    assert_eq!(rings, (blind.trials - blind.correct) as usize + 1);
    assert!(html.contains(&format!("<b>{} of 50 blind touches", blind.correct)));
}

#[test]
fn a_faulted_run_says_what_happened_first_and_what_is_missing() {
    let html = rendered(Story::Faulted);
    let alarm = inside(&html, "<p class=\"alarm\">", "</p>");
    assert_eq!(
        alarm,
        "<b>Fault in main/1/back/45/1.</b> linear stage: no answer within 100 ms. The probe was \
         lowered, and may be in contact. Check the cable of the &lt;linear stage&gt;."
    );
    assert!(html.find("class=\"alarm\"").unwrap() < html.find("class=\"tiles\"").unwrap());
    assert!(html.contains("<span class=\"status failed\">faulted</span>"));
    assert!(
        html.find("What happened").unwrap() < html.find("Planned, measured and refused").unwrap()
    );
    for empty in ["No blind touches", "<h2>Recognition</h2>"] {
        assert!(!html.contains(empty), "{empty}");
    }
    assert!(html.contains("7 <small>"));
    assert!(html.contains("the last frames on /dev/ttyUSB0 are in the journal (1)"));
    assert!(!html.contains("fig-left"), "nothing was touched from the left");
}

#[test]
fn a_journal_that_is_not_sound_says_so_above_its_numbers() {
    let sample = SampleRun::new(Story::Complete);
    assert!(sample.html().contains("<dt>checked</dt><dd>sound: as many records as there are</dd>"));
    let finding = "shift: record 40: the shift, Hz: expected 1, found <2>".to_owned();
    let sentence = "not sound: 1 finding in 40 records".to_owned();
    let html =
        sample.html_with(&RunVerdict { sentence: sentence.clone(), findings: vec![finding] });
    check_markup(&html);
    let alarm = inside(&html, "<div class=\"alarm\">", "</div>");
    assert!(alarm.starts_with("<b>The journal of this run is not sound.</b>"), "{alarm}");
    assert!(
        alarm.contains("<li>shift: record 40: the shift, Hz: expected 1, found &lt;2&gt;</li>")
    );
    assert!(html.find("not sound").unwrap() < html.find("class=\"tiles\"").unwrap());
    assert!(html.contains(&sentence));
}

#[test]
fn a_damaged_journal_is_reported_as_far_as_it_can_be_read() {
    let sample = SampleRun::new(Story::Complete);
    let keep = 200;
    let check = ChainCheck::Broken { seq: keep as u64 + 1, flaw: Flaw::Altered };
    let chain = Chain { records: sample.chain.records[..keep].to_vec(), check };
    let html = SampleRun { chain, ..sample }.html();
    check_markup(&html);
    assert!(html.contains(
        "<b>The journal of this run is damaged.</b> Record 201: the record does not match its \
         digest."
    ));
    assert!(html.contains("fig-mean"));
}

#[test]
fn the_summary_has_the_documented_fields() {
    let sample = SampleRun::new(Story::Complete);
    let found = sample.results().summary();
    let json = serde_json::to_value(&found).unwrap();
    let fields = |value: &serde_json::Value| {
        value.as_object().unwrap().keys().cloned().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(
        fields(&json),
        "aim calibration classification daily_check expected_seconds is_sealed is_simulated model no_load_hz prompts recognition rig_seconds run_id \
         sensitivity_hz_per_mpa shifts status stiffness touch_results touches touches_measured \
         touches_not_reached touches_planned touches_refused touches_skipped wall_seconds"
    );
    assert_eq!(fields(&json["shifts"][0]), "angle_deg direction sample shift_hz sigma_hz");
    assert_eq!(fields(&json["classification"]), "correct rate trials");
    assert_eq!(
        fields(&json["stiffness"][0]),
        "budget known_mpa planned sample sets_scale sigma_mpa stiffness_mpa used"
    );
    assert_eq!(
        fields(&json["calibration"]),
        "angle_deg described_rel factor is_beyond_description resonance_ratio samples sigma_rel"
    );
    assert_eq!(fields(&json["recognition"][0]), "correct high low method rate trials");
    assert_eq!(
        fields(&json["model"]),
        "added_rel arm_mm chi2_per_dof degrees_of_freedom depth depth_described \
         depth_exponent_noticed evidence pattern pattern_sample slip_begins_below \
         slip_noticed_below tangential_ratio verdict"
    );
    assert_eq!(json["model"]["verdict"], "holds");
    assert_eq!(json["status"], "completed");
    assert_eq!(json["touches"], 110);
    assert_eq!(json["prompts"], 65);
    assert_eq!(json["rig_seconds"], 1297.0);
    assert_eq!(json["wall_seconds"], 4.18);
    assert_eq!(found.shifts.len(), 60);
}

/// Beyond 10° the contact slips: the shifts fall there.
#[test]
fn a_rejected_model_is_marked_in_every_output_and_widens_the_intervals() {
    let mut sample = SampleRun::new(Story::Complete);
    let sigmas = |sample: &SampleRun| {
        let found = sample.results().summary().stiffness;
        found.iter().map(|one| one.sigma_mpa.unwrap()).collect::<Vec<_>>()
    };
    let before = sigmas(&sample);
    sample.change_touches(|touch| {
        touch.shift_hz *= if touch.touch.pose.angle_deg > 10.0 { 0.7 } else { 1.0 };
    });
    let found = sample.results().summary();
    let model = found.model.as_ref().unwrap();
    assert_eq!((model.verdict, model.pattern), ("rejected", Some("friction")), "{model:?}");
    assert!(model.chi2_per_dof > 2.0 && model.added_rel > 0.05, "{model:?}");
    for (before, after) in before.iter().zip(sigmas(&sample)) {
        assert!(after > 2.0 * before, "{after} after {before}");
    }
    for row in found.touch_results.iter().filter(|row| row.stiffness_mpa.is_some()) {
        assert_eq!(row.model_verdict, Some("rejected"), "{row:?}");
        assert_eq!(row.model_residual.is_some(), row.phase == "main", "{row:?}");
    }
    let text = sample.results().text();
    assert!(text.contains("model                  rejected: friction; χ²/"), "{text}");
    let html = sample.html();
    assert!(html.contains("The model is rejected</span>: χ² of the main touches is"));
    assert!(html.contains("removes of χ²"));
}

#[test]
fn the_model_of_the_rig_file_is_kept_when_the_protocol_asks_for_it() {
    let mut sample = SampleRun::new(Story::Complete);
    let model = |sample: &SampleRun| sample.results().summary().model.unwrap();
    let learnt = model(&sample);
    assert!(learnt.tangential_ratio.sigma.is_some_and(|sigma| sigma < 0.1), "{learnt:?}");
    sample.change_start(|started| {
        let text = &started.protocol.toml;
        started.protocol.toml = format!("model = \"described\"\n{text}");
    });
    let described = model(&sample);
    let ratio = described.tangential_ratio;
    assert_eq!((ratio.value, ratio.sigma), (ratio.described, None));
    assert!(described.chi2_per_dof >= learnt.chi2_per_dof, "{described:?}");
}

#[test]
fn references_by_drift_are_between_the_one_before_a_touch_and_the_one_after_it() {
    let mut sample = SampleRun::new(Story::Complete);
    let held = sample.results().touches().to_vec();
    assert!(held.iter().all(|row| row.next_no_load_sweep.is_none()));
    sample.change_start(by_drift);
    let results = sample.results();
    for (row, held) in results.touches().iter().zip(&held) {
        let moved_hz = row.no_load_hz.unwrap() - held.no_load_hz.unwrap();
        let shift_hz = held.shift_hz.unwrap() - moved_hz;
        assert!((row.shift_hz.unwrap() - shift_hz).abs() < 1e-9, "{row:?}");
        assert!(row.shift_sigma_hz <= held.shift_sigma_hz, "{row:?}");
        assert_eq!(row.next_no_load_sweep.is_some(), moved_hz != 0.0, "{row:?}");
    }
    let moved = results.touches().iter().filter(|row| row.next_no_load_sweep.is_some()).count();
    assert!(
        (80..110).contains(&moved),
        "{moved}: none before a turn of the sensor, and not the last"
    );
}

/// The protocol of a run with references by drift.
pub(crate) fn by_drift(started: &mut rig_record::RunStarted) {
    let text = &started.protocol.toml;
    started.protocol.toml = format!("no_load = \"by-drift\"\n{text}");
}

#[test]
fn the_numbers_are_those_of_the_touches() {
    let sample = SampleRun::new(Story::Complete);
    let found = sample.results().summary();
    let recorded: Vec<rig_record::Touch> = sample
        .chain
        .records
        .iter()
        .filter_map(|stored| match stored.record().unwrap() {
            rig_record::Record::TouchResult(touch) => Some(touch),
            _ => None,
        })
        .collect();
    let results = sample.results();
    let touches = results.touches();
    for shift in &found.shifts {
        let row = touches.iter().find(|row| {
            row.phase == "main"
                && row.sample == shift.sample
                && row.direction == shift.direction
                && row.angle_deg == shift.angle_deg
        });
        let row = row.unwrap();
        let of_row = (row.shift_hz.unwrap(), row.shift_sigma_hz.unwrap());
        assert_eq!((shift.shift_hz, shift.sigma_hz), of_row);
    }
    let mean_at_normal = |name: &str| {
        let at_normal = |shift: &&ShiftSummary| shift.sample == name && shift.angle_deg == 0.0;
        found.shifts.iter().filter(at_normal).map(|shift| shift.shift_hz).sum::<f64>() / 3.0
    };
    let chord = (mean_at_normal("5") - mean_at_normal("1")) / (0.649 - 0.045);
    assert!((found.sensitivity_hz_per_mpa.unwrap() - chord).abs() < 1e-9, "{chord}");
    let no_load = recorded.iter().map(|touch| touch.no_load_hz).sum::<f64>() / 110.0;
    assert!((found.no_load_hz.unwrap() - no_load).abs() < 1e-9, "{no_load}");
}

#[test]
fn stiffness_is_scaled_by_the_samples_that_are_known_and_says_so() {
    let sample = SampleRun::new(Story::Complete);
    let html = sample.html();
    assert!(html.contains("The touches at 0° of 5 samples of known stiffness give"));
    let found = sample.results().summary();
    for sample in &found.stiffness {
        let known_mpa = sample.known_mpa.unwrap();
        let (found_mpa, sigma_mpa) = (sample.stiffness_mpa.unwrap(), sample.sigma_mpa.unwrap());
        assert!((found_mpa - known_mpa).abs() < 3.0 * sigma_mpa, "{sample:?}");
        assert!(sigma_mpa / known_mpa < 0.05, "{sample:?}");
        assert_eq!((sample.used, sample.planned), (12, 12));
    }
    let methods: Vec<_> = found.recognition.iter().map(|found| found.method).collect();
    assert_eq!(methods, ["k-means", "k-means-log", "calibrated-stiffness"]);
    let [k_means, _, calibrated] = found.recognition[..] else { panic!() };
    assert_eq!(k_means.correct, found.classification.unwrap().correct);
    assert!(k_means.correct < calibrated.correct, "{:?}", found.recognition);
}

#[test]
fn without_known_samples_the_scale_is_as_uncertain_as_the_rig_file_says() {
    let mut sample = SampleRun::new(Story::Complete);
    let known = sample.results().summary();
    sample.change_start(|started| {
        for sample in &mut started.samples {
            sample.stiffness_mpa = None;
        }
    });
    let html = sample.html();
    check_markup(&html);
    assert!(html.contains("No sample is known") && !html.contains("fig-stiffness"));
    let found = sample.results().summary();
    for found in &found.stiffness {
        assert_eq!(found.known_mpa, None);
        assert!(found.sigma_mpa.unwrap() / found.stiffness_mpa.unwrap() > 0.1, "{found:?}");
    }
    // One factor for all touches changes no class.
    assert_eq!(found.recognition, known.recognition);
}

#[test]
fn unknown_angles_are_found_with_the_stiffness_or_said_to_be_lost() {
    let mut sample = SampleRun::new(Story::Complete);
    let known = sample.results().summary();
    sample.change_start(|started| started.protocol.toml += "angle = \"unknown\"\n");
    let html = sample.html();
    check_markup(&html);
    let sites = inside(&html, "<caption>Stiffness, contact angle and azimuth", "</table>");
    assert_eq!(sites.matches("<tr><th scope=\"row\">").count(), 20);
    // Upright, the directions do not differ, and the touches say nothing about the azimuth.
    assert!(sites.contains("not identified"));
    let found = sample.results().summary();
    // Five samples at four angles.
    assert_eq!(found.model.unwrap().degrees_of_freedom, 20 - 5);
    assert!(found.touch_results.iter().all(|row| row.model_verdict.is_some()));
    for (found, known) in found.stiffness.iter().zip(&known.stiffness) {
        let known_mpa = found.known_mpa.unwrap();
        let (found_mpa, sigma_mpa) = (found.stiffness_mpa.unwrap(), found.sigma_mpa.unwrap());
        assert!((found_mpa - known_mpa).abs() < 3.0 * sigma_mpa, "{found:?}");
        assert!(sigma_mpa > known.sigma_mpa.unwrap(), "{found:?} {known:?}");
        check_budget(&found.budget.unwrap(), sigma_mpa);
    }
    let of_angle = |row: &TouchRow| row.budget.unwrap().angle_mpa / row.stiffness_mpa.unwrap();
    for (found, known) in found.touch_results.iter().zip(&known.touch_results) {
        check_budget(&found.budget.unwrap(), found.stiffness_sigma_mpa.unwrap());
        assert!(found.budget.unwrap().sample_mpa > 0.0, "{found:?}");
        // One touch says nothing about its angle.
        let is_blind = found.phase == "blind";
        assert!(!is_blind || of_angle(found) > 3.0 * of_angle(known), "{found:?} {known:?}");
    }
    let budget =
        inside(&html, "<caption>Standard deviations of the stiffness by cause", "</table>");
    assert_eq!(budget.matches("<tr><th scope=\"row\">").count(), 5);
    assert!(html.contains("fig-budget"));
}

#[test]
fn a_site_without_contact_is_refused_with_the_reason() {
    let mut sample = SampleRun::new(Story::Complete);
    sample.change_start(|started| started.protocol.toml += "angle = \"unknown\"\n");
    let mut is_first = true;
    sample.change_touches(|touch| {
        if std::mem::take(&mut is_first) {
            touch.shift_hz = -20.0;
        }
    });
    let html = sample.html();
    check_markup(&html);
    let sites = inside(&html, "<caption>Stiffness, contact angle and azimuth", "</table>");
    assert_eq!(sites.matches("a shift of -").count(), 1, "{sites}");
}

#[test]
fn a_journal_whose_rig_file_cannot_be_read_has_everything_but_stiffness() {
    let mut sample = SampleRun::new(Story::Complete);
    sample.change_start(|started| started.rig.toml = "name = \"<old>\"\n".to_owned());
    let html = sample.html();
    check_markup(&html);
    assert!(html.contains("No stiffness: the rig file in the journal"));
    assert!(html.contains("fig-blind-t"));
    let found = sample.results().summary();
    assert!(found.stiffness.is_empty());
    assert_eq!(found.recognition.len(), 2);
}

#[test]
fn a_person_at_a_terminal_reads_a_table() {
    let sample = SampleRun::new(Story::Complete);
    insta::assert_snapshot!(sample.results().text());
    let sample = SampleRun::new(Story::Empty);
    let nothing = sample.results().text();
    assert!(nothing.ends_with(
        "aborted: 0.0 s of rig time in 4.2 s\n0 of 110 touches measured; 110 not reached\n"
    ));
    assert_eq!(nothing.matches("not reached").count(), 20 * 4 + 1, "{nothing}");
}

#[test]
fn a_sample_that_gives_the_factor_alone_has_no_uncertainty_in_any_output() {
    let mut sample = SampleRun::new(Story::Complete);
    // Of the first sample, one touch is left; the others are not known.
    sample.chain.records.retain(|stored| match stored.record().unwrap() {
        rig_record::Record::TouchResult(touch) => touch.touch.step == "main/1/left/0/1",
        _ => true,
    });
    let results = sample.results();
    let first = &results.summary().stiffness[0];
    assert!(first.sets_scale && first.stiffness_mpa.is_some(), "{first:?}");
    assert_eq!((first.sigma_mpa, &first.budget), (None, &None));
    let text = results.text();
    assert!(text.contains("used for the scale") && !text.contains("± 0.000"), "{text}");
    let html = sample.html();
    check_markup(&html);
    assert!(html.contains("<td>used for the scale</td>"));
    assert!(!html.contains("NaN") && !html.contains("fig-budget") && !html.contains("chart:"));
    // Another sample, and touches at other angles, are measured by it.
    let all = SampleRun::new(Story::Complete).results().summary();
    assert!(all.stiffness.iter().all(|found| !found.sets_scale && found.sigma_mpa.is_some()));
}

/// The rows of the table of touches by the address of their step.
fn table(sample: &SampleRun) -> Vec<BTreeMap<String, String>> {
    let mut bytes = Vec::new();
    let (name, format) = (export::TableName::Touches, export::TableFormat::Csv);
    export::table(name, format, &sample.results(), &sample.chain.records, &mut bytes).unwrap();
    csv::Reader::from_reader(bytes.as_slice()).deserialize().map(Result::unwrap).collect()
}

#[test]
fn every_planned_touch_has_a_row_in_every_output() {
    for (story, expected) in [
        (Story::Complete, (110, 0, 0)),
        (Story::Refused, (108, 2, 0)),
        (Story::Faulted, (7, 0, 103)),
        (Story::Empty, (0, 0, 110)),
    ] {
        let sample = SampleRun::new(story);
        let rows = table(&sample);
        let count = |status: &str| rows.iter().filter(|row| row["status"] == status).count();
        let counts = (count("measured"), count("refused"), count("not_reached"));
        assert_eq!(counts, expected, "{story:?}");
        for row in &rows {
            assert_eq!(row["reason"].is_empty(), row["status"] == "measured", "{row:?}");
            assert_eq!(row["shift_hz"].is_empty(), row["status"] != "measured", "{row:?}");
            assert_eq!(row["stiffness_mpa"].is_empty(), row["status"] != "measured", "{row:?}");
        }
        let found = sample.results().summary();
        let counts = (found.touches_measured, found.touches_refused, found.touches_not_reached);
        assert_eq!((counts, found.touches_planned), (expected, 110));
        let steps = |rows: &[TouchRow]| rows.iter().map(|r| r.step.clone()).collect::<Vec<_>>();
        let in_table: Vec<_> = rows.iter().map(|row| row["step"].clone()).collect();
        assert_eq!(steps(&found.touch_results), in_table);
        let html = sample.html();
        let touches = inside(&html, "<caption>Every planned touch", "</table>");
        assert_eq!(touches.matches("<tr><th scope=\"row\">").count(), 110);
        for (status, count) in [("refused", expected.1), ("not reached", expected.2)] {
            let cell = format!("<td><span class=\"fault\">{status}</span></td>");
            assert_eq!(touches.matches(&cell).count(), count, "{story:?}: {status}");
        }
    }
}

#[test]
fn every_output_names_a_refused_touch_with_its_reason() {
    let sample = SampleRun::new(Story::Refused);
    let reason = "the analyzer flagged <overload> at 152.3 Hz in 3 of 3 tries";
    let text = sample.results().text();
    assert!(text.contains(&format!("\nmain/2/left/45/1  {reason}\n")), "{text}");
    assert!(text.contains(&format!("\nblind/3           {reason}\n")), "{text}");
    assert!(text.contains("11 of 12 touches") && text.contains("(2 of 3)"), "{text}");
    assert!(text.contains(" of 49 correct, ") && text.contains("; 1 without a shift\n"), "{text}");
    assert!(
        text.ends_with(
            "completed with refusals: 21 min 37 s of rig time in 4.2 s\n\
         108 of 110 touches measured; 2 refused: main/2/left/45/1, blind/3\n"
        ),
        "{text}"
    );
    let html = sample.html();
    check_markup(&html);
    assert!(html.contains("<span class=\"status partial\">completed with refusals</span>"));
    assert!(html.contains("<span class=\"fault\">11 of 12 touches</span>"));
    let escaped = reason.replace('<', "&lt;").replace('>', "&gt;");
    let refused = html.match_indices("<figcaption>Refused sweep").map(|(at, _)| &html[at..]);
    let captions: Vec<_> =
        refused.map(|rest| inside(rest, "<figcaption>", "</figcaption>")).collect();
    assert_eq!(captions.len(), 2);
    assert!(captions.iter().all(|caption| caption.contains(&escaped)), "{captions:?}");
    assert!(captions[0].contains("main/2/left/45/1, 24 readings"), "{captions:?}");
}

#[test]
fn a_touch_that_was_not_reached_has_a_reason() {
    let rows = table(&SampleRun::new(Story::Faulted));
    let reason = |step: &str| &rows.iter().find(|row| row["step"] == step).unwrap()["reason"];
    assert_eq!(
        reason("main/1/back/45/1"),
        "a fault ended the run during this touch: linear stage: no answer within 100 ms"
    );
    assert_eq!(reason("blind/50"), "a fault ended the run: linear stage: no answer within 100 ms");
    assert_eq!(table(&SampleRun::new(Story::Empty))[0]["reason"], "the run was aborted");
}

/// The model of a run takes long to learn; most records of a run under way change nothing about it.
#[test]
fn the_stiffness_is_kept_until_a_touch_comes() {
    let sample = SampleRun::new(Story::Complete);
    let (run, records) = (&sample.run, &sample.chain.records);
    let before = RunResults::new(run, &records[..records.len() - 1]).unwrap();
    let after = RunResults::after(run, records, Some(&before)).unwrap();
    let stiffness = |results: &RunResults| Arc::clone(results.stiffness.as_ref().unwrap());
    assert!(Arc::ptr_eq(&stiffness(&before), &stiffness(&after)));
    let is_touch = |one: &StoredRecord| one.payload.contains("\"touch_result\"");
    let last = records.iter().rposition(is_touch).unwrap();
    let shorter = RunResults::new(run, &records[..last]).unwrap();
    let grown = RunResults::after(run, records, Some(&shorter)).unwrap();
    assert!(!Arc::ptr_eq(&stiffness(&shorter), &stiffness(&grown)));
}

/// The squares of the parts add up, and a run with noise has each of the first five.
#[track_caller]
fn check_budget(budget: &StiffnessBudget, sigma_mpa: f64) {
    let StiffnessBudget { sweep_mpa, reference_mpa, surface_mpa, depth_mpa, angle_mpa, .. } =
        *budget;
    let own = [sweep_mpa, reference_mpa, surface_mpa, depth_mpa, angle_mpa];
    assert!(own.iter().all(|part| *part > 0.0), "{budget:?}");
    let all = own.into_iter().chain([budget.sensor_mpa, budget.model_mpa, budget.sample_mpa]);
    let together = all.map(|part| part * part).sum::<f64>().sqrt();
    assert!((together / sigma_mpa - 1.0).abs() < 1e-9, "{budget:?} is not {sigma_mpa}");
}

#[test]
fn the_table_of_touches_has_every_value_of_a_touch() {
    let sample = SampleRun::new(Story::Complete);
    let rows = table(&sample);
    let row = &rows[1];
    let given = ["step", "phase", "sample", "direction", "angle_deg", "repeat", "status"];
    let expected = ["main/1/front/15/1", "main", "1", "front", "15.0", "1", "measured"];
    assert_eq!(given.map(|column| row[column].as_str()), expected);
    assert_eq!([&row["linear_mm"], &row["rotary_deg"]], ["9.6000", "15.0000"]);
    assert_eq!([&row["known_mpa"], &row["is_simulated"]], ["0.045", "true"]);
    assert_eq!((row["class"].as_str(), row["run_id"].clone()), ("", sample.run.id.to_string()));
    assert_eq!(row["started_at"].len(), "2026-11-21T08:15:42.120Z".len());
    assert!(rows[0]["started_at"] < row["started_at"], "{row:?}");
    let found = sample.results().summary();
    for row in &found.touch_results {
        let (known, sigma) = (row.known_mpa.unwrap(), row.stiffness_sigma_mpa.unwrap());
        assert!((row.stiffness_mpa.unwrap() - known).abs() < 6.0 * sigma, "{row:?}");
        check_budget(&row.budget.unwrap(), sigma);
    }
    for sample in &found.stiffness {
        check_budget(&sample.budget.unwrap(), sample.sigma_mpa.unwrap());
    }
    let blind = || found.touch_results.iter().filter(|row| row.phase == "blind");
    let is_right = |row: &&TouchRow| row.class.as_deref() == Some(row.sample.as_str());
    let right = blind().filter(is_right).count();
    assert_eq!(right, found.classification.unwrap().correct as usize);
}
