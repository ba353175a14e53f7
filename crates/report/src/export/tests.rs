//! The tables of records, and their independence of time and id.

#[path = "../../../record/tests/support/sweep.rs"]
mod sweep;

use std::collections::BTreeMap;

use ::parquet::{
    file::reader::{FileReader, SerializedFileReader},
    record::Field,
};
use rig_record::{
    CheckedSurface, Record, StoredRecord, Surface, SurfaceReading, SweepOutcome, SweepPurpose,
};
use serde_json::Value;

use super::*;
use crate::tests::sample::{self, SampleRun, Story};
use sweep::{POSE, STEP, reading, sweep};

/// A simulated run with a search for a surface, two sweeps and a check of the surface.
fn records() -> Vec<StoredRecord> {
    let trail = vec![SurfaceReading { position_mm: 10.3, reading: reading(140.0, 0) }];
    let sigma_mm = 0.01 / 12.0_f64.sqrt();
    let checked = CheckedSurface { step: STEP.to_owned(), pose: POSE, trail: trail.clone() };
    let found = Surface {
        step: STEP.to_owned(),
        pose: POSE,
        position_mm: 10.1,
        sigma_mm,
        onset: None,
        trail,
    };
    let records = [
        sample::started(Vec::new()),
        Record::Sweep(sweep(1, SweepPurpose::NoLoad, 140.4)),
        Record::SurfaceFound(found),
        Record::Sweep(sweep(2, SweepPurpose::Touch, 158.3)),
        Record::SurfaceChecked(checked),
    ];
    sample::chain(&records.map(|record| (1_000_000, record))).records
}

/// A table of these records as CSV.
fn csv(name: TableName, records: &[StoredRecord]) -> String {
    let run = SampleRun::new(Story::Empty).run;
    let results = RunResults::new(&run, records).unwrap();
    text(|out| table(name, TableFormat::Csv, &results, records, out))
}

fn text(table: impl Fn(&mut Vec<u8>) -> Result<(), ExportError>) -> String {
    let mut bytes = Vec::new();
    table(&mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

#[test]
fn tables_have_a_row_for_each_sweep_and_reading() {
    let records = records();
    let (sweeps, readings) = (csv(TableName::Sweeps, &records), csv(TableName::Readings, &records));
    let row = |number, purpose, hz| {
        format!(
            "{number},\"{purpose}\",\"main/1/back/30/1\",\"back\",30.0,5.0,12,\"accepted\",{hz},0.0200,\
             1.250000,33.0,0.12,2.74e-8,1.1e-10,0.08,0.0007,0.018000,0.000410,,1,true\n"
        )
    };
    assert_eq!(
        sweeps,
        "sweep,purpose,step,direction,angle_deg,level_v,readings,outcome,resonance_hz,sigma_hz,\
         effective_time_s,quality_factor,quality_factor_sigma,static_capacitance_f,\
         static_capacitance_sigma_f,capacitance_ratio,capacitance_ratio_sigma,loss_tangent,\
         loss_tangent_sigma,reason,clock,is_simulated\n"
            .to_owned()
            + &row(1, "no_load", "140.4000")
            + &row(2, "touch", "158.3000")
    );
    assert_eq!(readings.lines().count(), 1 + 2 * 12);
    let columns = readings.lines().next().unwrap().split(',').count();
    assert!(readings.lines().all(|line| line.split(',').count() == columns), "{readings}");
    let first = "\n1,\"no_load\",\"main/1/back/30/1\",1,140.4,33333.333333333336,-40000.0,";
    assert!(readings.contains(first), "{readings}");
    // The settings of the fit, if the journal has them; two readings of each sweep are flagged.
    let ends = |end: &str| readings.lines().filter(|line| line.ends_with(end)).count();
    assert_eq!(
        ends(",true,130.0,260.0,0.005,4.0,\"waited\",true,,,,,,,,,,,,,,,1,true"),
        10,
        "{readings}"
    );
    assert_eq!(ends(",true,,,,,,,,,,,,,,,,,,,,,1,true"), 10, "{readings}");
    let header = "frequency_hz,resistance_ohm,reactance_ohm,started_s,settle_s,integration_s,flag,\
                  is_used,fit_min_hz,fit_max_hz,fit_noise_at_ten_cycles,\
                  fit_noise_degrees_of_freedom,fit_timing,fit_always_loss,fit_target_sigma_hz,\
                  fit_near_resonance_hz,fit_near_quality_factor,fit_near_static_capacitance_f,\
                  fit_near_capacitance_ratio,fit_near_loss_tangent,fit_bench_phase_rad,\
                  fit_bench_phase_sigma_rad,fit_bench_first_gap_s,fit_bench_dispersion_f,\
                  fit_bench_dispersion_sigma_f,fit_bench_mode_sigma,fit_bench_min_hz,fit_bench_max_hz";
    let named = format!("sweep,purpose,step,reading,{header},clock,is_simulated\n");
    assert!(readings.starts_with(&named), "{readings}");
    let single = text(|out| sweep_csv(&sweep(7, SweepPurpose::Touch, 158.3), out));
    assert!(single.starts_with(header), "{single}");
    assert_eq!(single.lines().count(), 1 + 12);
}

#[test]
fn a_refused_sweep_keeps_its_columns() {
    let mut refused = sweep(1, SweepPurpose::Manual, 140.0);
    refused.outcome = SweepOutcome::Refused { reason: "no resonance, none at all".to_owned() };
    (refused.step, refused.pose) = (None, None);
    let records = sample::chain(&[(0, Record::Sweep(refused))]).records;
    let sweeps = csv(TableName::Sweeps, &records);
    let (header, row) = sweeps.split_once('\n').unwrap();
    assert_eq!(
        row,
        "1,\"manual\",,,,5.0,12,\"refused\",,,,,,,,,,,,\"no resonance, none at all\",1,false\n"
    );
    // The reason contains a comma.
    assert_eq!(row.matches(',').count(), header.matches(',').count() + 1);
}

#[test]
fn every_position_of_a_search_and_of_a_check_of_the_surface_is_a_row() {
    let rest =
        "10.3000,140.0,33333.333333333336,-40000.0,0.3333333333333333,0.05,0.1,\"normal\",1,true";
    assert_eq!(
        csv(TableName::Searches, &records()),
        format!(
            "step,purpose,direction,angle_deg,surface_mm,surface_sigma_mm,try,position_mm,frequency_hz,\
             resistance_ohm,reactance_ohm,started_s,settle_s,integration_s,flag,clock,is_simulated\n\
             \"main/1/back/30/1\",\"search\",\"back\",30.0,10.10000,0.00289,1,{rest}\n\
             \"main/1/back/30/1\",\"check\",\"back\",30.0,,,1,{rest}\n"
        )
    );
}

#[test]
fn every_record_is_a_line_without_the_id_of_the_run() {
    let records = records();
    let lines = text(|out| jsonl(&records, out));
    assert_eq!(lines.lines().count(), 5);
    for (line, stored) in lines.lines().zip(&records) {
        let value: serde_json::Value = serde_json::from_str(line).unwrap();
        assert_eq!(value["digest"], stored.digest.to_string());
        assert_eq!(value["record"]["kind"], stored.kind);
        assert_eq!((&value["seq"], &value["rig_us"]), (&stored.seq.into(), &1_000_000.into()));
        assert!(!line.contains(&stored.run.to_string()), "{line}");
    }
}

/// A cell of CSV and one of Parquet have the same value.
#[track_caller]
fn check_cell(column: &Column, text: &str, field: &Field) {
    let is_same = match field {
        Field::Null => text.is_empty(),
        Field::Str(value) => text == value,
        Field::Long(value) => text == value.to_string(),
        Field::Bool(value) => text == value.to_string(),
        Field::TimestampMillis(value) => crate::units::unix_ms(text) == Some(*value),
        Field::Double(value) => {
            let decimals = text.split('.').nth(1).map_or(0, str::len);
            text == format!("{value:?}")
                || (text == format!("{value:.decimals$}"))
                || (text.parse::<f64>().unwrap() / value - 1.0).abs() < 1e-5
        }
        other => panic!("{column:?}: {other:?}"),
    };
    assert!(is_same, "{}: {text} and {field:?}", column.name);
}

/// A table as Parquet has the rows of the same table as CSV, and says what each column means.
fn check_parquet(name: TableName, results: &RunResults, records: &[StoredRecord]) {
    let write = |format| {
        let mut bytes = Vec::new();
        let mut export = TableExport::new(name, format, true, &mut bytes).unwrap();
        // Both runs of a table of several.
        export.add(results, records).unwrap();
        export.add(results, records).unwrap();
        export.finish().unwrap();
        bytes
    };
    let (csv, parquet) = (write(TableFormat::Csv), write(TableFormat::Parquet));
    assert_eq!(parquet, write(TableFormat::Parquet), "the same records give the same bytes");
    let mut lines = ::csv::Reader::from_reader(&csv[..]);
    let columns = [&[column::RUN][..], &name.columns()].concat();
    assert!(lines.headers().unwrap().iter().eq(columns.iter().map(|column| column.name)));
    let reader = SerializedFileReader::new(bytes::Bytes::from(parquet)).unwrap();
    let metadata = reader.metadata().file_metadata().key_value_metadata().unwrap();
    let dictionary = metadata.iter().find(|entry| entry.key == "rigd:columns").unwrap();
    let dictionary: Value = serde_json::from_str(dictionary.value.as_ref().unwrap()).unwrap();
    let units =
        dictionary.as_array().unwrap().iter().map(|column| column["unit"].as_str().unwrap());
    assert!(units.eq(columns.iter().map(|column| column.unit)));
    let mut rows = 0;
    for (line, row) in lines.records().zip(reader.get_row_iter(None).unwrap()) {
        let (line, row) = (line.unwrap(), row.unwrap());
        assert_eq!(line.len(), columns.len());
        for ((column, text), (path, field)) in columns.iter().zip(&line).zip(row.get_column_iter())
        {
            assert_eq!(column.name, path);
            check_cell(column, text, field);
        }
        rows += 1;
    }
    assert!(rows > 0 && String::from_utf8(csv).unwrap().lines().count() == rows + 1, "{name:?}");
}

/// `tests/peers/tables.py` reads such a file with the library of its makers.
#[test]
fn hdf5_has_its_whole_length_and_the_same_bytes_for_the_same_records() {
    let (records, run) = (records(), SampleRun::new(Story::Refused).run);
    let results = RunResults::new(&run, &records).unwrap();
    let file = |runs: usize| {
        let mut export = Hdf5Export::new(1 < runs);
        for _ in 0..runs {
            export.add(&results, &records).unwrap();
        }
        export.finish()
    };
    let (one, two) = (file(1), file(2));
    assert!(one == file(1) && one.len() < two.len() && file(0).len() < one.len());
    for bytes in [one, two] {
        assert!(bytes.starts_with(b"\x89HDF\r\n\x1a\n"));
        assert_eq!(bytes[40..48], (bytes.len() as u64).to_le_bytes());
        let names = TableName::ALL.iter().flat_map(|name| name.columns());
        for column in names {
            let name = column.name.as_bytes();
            assert!(bytes.windows(name.len()).any(|window| window == name), "{}", column.name);
        }
    }
}

#[test]
fn parquet_has_the_rows_and_the_columns_of_csv() {
    let refused = SampleRun::new(Story::Refused);
    check_parquet(TableName::Touches, &refused.results(), &refused.chain.records);
    let records = records();
    let results = RunResults::new(&refused.run, &records).unwrap();
    for name in [TableName::Sweeps, TableName::Readings, TableName::Searches] {
        check_parquet(name, &results, &records);
    }
}

#[test]
fn the_documents_of_a_run_have_a_start_both_streams_and_a_stop() {
    for (story, status, touches) in
        [(Story::Complete, "success", 110), (Story::Faulted, "fail", 7), (Story::Empty, "abort", 0)]
    {
        let run = SampleRun::new(story);
        let text = text(|out| documents(&run.results(), &run.chain.records, out));
        let lines = text.lines().map(|line| serde_json::from_str(line).unwrap());
        let all: Vec<Value> = lines.collect();
        let (first, last) = (&all[0], all.last().unwrap());
        assert_eq!((&first["name"], &last["name"]), (&"start".into(), &"stop".into()));
        assert_eq!(last["doc"]["exit_status"], status, "{story:?}");
        let mut events = BTreeMap::from([("primary".to_owned(), 0), ("sweeps".to_owned(), 0)]);
        let mut keys = BTreeMap::new();
        for line in &all {
            let doc = &line["doc"];
            match line["name"].as_str().unwrap() {
                "descriptor" => {
                    let names = doc["data_keys"].as_object().unwrap().keys().cloned();
                    keys.insert(
                        doc["uid"].to_string(),
                        (doc["name"].clone(), names.collect::<Vec<_>>()),
                    );
                }
                "event" => {
                    let (stream, names) = &keys[&doc["descriptor"].to_string()];
                    assert!(doc["data"].as_object().unwrap().keys().eq(names), "{doc}");
                    *events.get_mut(stream.as_str().unwrap()).unwrap() += 1;
                }
                _ => {}
            }
        }
        assert_eq!(events["primary"], touches, "{story:?}");
        assert_eq!(last["doc"]["num_events"], serde_json::json!(events), "{story:?}");
    }
}

#[test]
fn a_sweep_as_touchstone_has_the_reflection_of_each_reading_without_a_flag() {
    let sweep = sweep(3, SweepPurpose::Touch, 158.3);
    let text = text(|out| touchstone(&sweep, out));
    let rows: Vec<Vec<f64>> = text
        .lines()
        .filter(|line| !line.starts_with(['!', '#']))
        .map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect())
        .collect();
    assert!(text.contains("# HZ S RI R 50\n"), "{text}");
    let normal: Vec<_> = sweep.readings.iter().filter(|reading| reading.is_normal()).collect();
    assert_eq!(rows.len(), normal.len());
    for (row, reading) in rows.iter().zip(normal) {
        let [frequency_hz, real, imaginary] = row[..] else { panic!("{row:?}") };
        assert_eq!(frequency_hz, reading.frequency_hz);
        // Z = 50 Ω (1 + S) / (1 − S)
        let size = (1.0 - real).powi(2) + imaginary * imaginary;
        let (resistance, reactance) = reading.impedance_ohm().unwrap();
        let found = 50.0 * (1.0 - real * real - imaginary * imaginary) / size;
        assert!((found / resistance - 1.0).abs() < 1e-9, "{found} and {resistance}");
        assert!((100.0 * imaginary / size / reactance - 1.0).abs() < 1e-9);
    }
}

#[test]
fn the_manual_has_the_dictionary_of_every_table() {
    let manual = include_str!("../../../../docs/data.md");
    for name in TableName::ALL {
        let dictionary = name.dictionary();
        assert!(manual.contains(&dictionary), "write into docs/data.md:\n{dictionary}");
        let mut columns: Vec<_> = name.columns().iter().map(|column| column.name).collect();
        columns.sort_unstable();
        columns.dedup();
        assert_eq!(columns.len(), name.columns().len(), "a name is given twice");
    }
    let dictionary = column::dictionary(&column::SEALED);
    assert!(manual.contains(&dictionary), "write into docs/data.md:\n{dictionary}");
}

#[test]
fn records_that_come_in_parts_give_the_same_table() {
    let records = records();
    let run = SampleRun::new(Story::Empty).run;
    for name in [TableName::Sweeps, TableName::Readings, TableName::Searches] {
        for format in TableFormat::ALL {
            let results = RunResults::new(&run, &records).unwrap();
            let (mut whole, mut parts) = (Vec::new(), Vec::new());
            table(name, format, &results, &records, &mut whole).unwrap();
            let of = RunColumns::new(&run, vec![records[0].epoch], true);
            let mut export = TableExport::new(name, format, false, &mut parts).unwrap();
            for part in records.chunks(2) {
                export.add_records(&of, part).unwrap();
            }
            export.finish().unwrap();
            assert_eq!(parts, whole, "{name:?} {format:?}");
        }
    }
}
