//! The tables of records, and their independence of time and id.

#[path = "../../../record/tests/support/sweep.rs"]
mod sweep;

use rig_record::{Record, StoredRecord, Surface, SurfaceReading, SweepOutcome, SweepPurpose};

use super::*;
use crate::tests::sample;
use sweep::{POSE, STEP, reading, sweep};

/// A simulated run with a search for a surface and two sweeps.
fn records() -> Vec<StoredRecord> {
    let trail = vec![SurfaceReading { position_mm: 10.3, reading: reading(140.0, 0) }];
    let sigma_mm = 0.01 / 12.0_f64.sqrt();
    let found = Surface { step: STEP.to_owned(), pose: POSE, position_mm: 10.1, sigma_mm, trail };
    let records = [
        sample::started(Vec::new()),
        Record::Sweep(sweep(1, SweepPurpose::NoLoad, 140.4)),
        Record::SurfaceFound(found),
        Record::Sweep(sweep(2, SweepPurpose::Touch, 158.3)),
    ];
    sample::chain(&records.map(|record| (1_000_000, record))).records
}

fn text(table: impl Fn(&mut Vec<u8>) -> Result<(), ExportError>) -> String {
    let mut bytes = Vec::new();
    table(&mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

#[test]
fn tables_have_a_row_for_each_sweep_and_reading() {
    let records = records();
    let (sweeps, readings) =
        (text(|out| sweeps_csv(&records, out)), text(|out| readings_csv(&records, out)));
    let row = |number, purpose, hz| {
        format!(
            "{number},\"{purpose}\",\"main/1/back/30/1\",\"back\",30.0,12,\"accepted\",{hz},0.0200,\
             1.250000,33.0,2.74e-8,0.08,0.018000,0.000410,,1,true\n"
        )
    };
    assert_eq!(
        sweeps,
        "sweep,purpose,step,direction,angle_deg,readings,outcome,resonance_hz,sigma_hz,\
         effective_time_s,quality_factor,static_capacitance_f,capacitance_ratio,loss_tangent,\
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
    assert_eq!(ends(",true,130.0,260.0,0.005,4.0,\"waited\",true,,,,,,,1,true"), 10, "{readings}");
    assert_eq!(ends(",true,,,,,,,,,,,,,1,true"), 10, "{readings}");
    let header = "frequency_hz,resistance_ohm,reactance_ohm,started_s,settle_s,integration_s,flag,\
                  is_used,fit_min_hz,fit_max_hz,fit_noise_at_ten_cycles,\
                  fit_noise_degrees_of_freedom,fit_timing,fit_always_loss,fit_target_sigma_hz,\
                  fit_near_resonance_hz,fit_near_quality_factor,fit_near_static_capacitance_f,\
                  fit_near_capacitance_ratio,fit_near_loss_tangent";
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
    let sweeps = text(|out| sweeps_csv(&records, out));
    let (header, row) = sweeps.split_once('\n').unwrap();
    assert_eq!(
        row,
        "1,\"manual\",,,,12,\"refused\",,,,,,,,,\"no resonance, none at all\",1,false\n"
    );
    // The reason contains a comma.
    assert_eq!(row.matches(',').count(), header.matches(',').count() + 1);
}

#[test]
fn every_position_tried_on_the_way_to_the_surface_is_a_row() {
    let records = records();
    assert_eq!(
        text(|out| searches_csv(&records, out)),
        "step,direction,angle_deg,surface_mm,surface_sigma_mm,try,position_mm,frequency_hz,\
         resistance_ohm,reactance_ohm,started_s,settle_s,integration_s,flag,clock,is_simulated\n\
         \"main/1/back/30/1\",\"back\",30.0,10.10000,0.00289,1,10.3000,140.0,33333.333333333336,\
         -40000.0,0.3333333333333333,0.05,0.1,\"normal\",1,true\n"
    );
}

#[test]
fn every_record_is_a_line_without_the_id_of_the_run() {
    let records = records();
    let lines = text(|out| jsonl(&records, out));
    assert_eq!(lines.lines().count(), 4);
    for (line, stored) in lines.lines().zip(&records) {
        let value: serde_json::Value = serde_json::from_str(line).unwrap();
        assert_eq!(value["digest"], stored.digest.to_string());
        assert_eq!(value["record"]["kind"], stored.kind);
        assert_eq!((&value["seq"], &value["rig_us"]), (&stored.seq.into(), &1_000_000.into()));
        assert!(!line.contains(&stored.run.to_string()), "{line}");
    }
}
