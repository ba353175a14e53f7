//! A sweep for the tests of the crates that store and export records.

use rig_record::{
    Circuit, Direction, Extra, FitNoise, FitSettings, FitTiming, Pose, ReadingFlag, ReadingRecord,
    Sweep, SweepOutcome, SweepPurpose,
};

pub(crate) const POSE: Pose = Pose { direction: Direction::Back, angle_deg: 30.0 };
pub(crate) const STEP: &str = "main/1/back/30/1";

/// The reading with this index. The third is flagged as low signal; the fourth is an overload without
/// an impedance.
pub(crate) fn reading(resonance_hz: f64, index: u32) -> ReadingRecord {
    ReadingRecord {
        frequency_hz: resonance_hz + 0.1 * f64::from(index),
        resistance_ohm: (index != 3).then(|| 1e5 / f64::from(index + 3)),
        reactance_ohm: (index != 3).then(|| -4e4 - f64::from(index).sqrt()),
        started_s: 1.0 / 3.0 + f64::from(index),
        settle_s: 0.05,
        integration_s: 0.1,
        flag: match index {
            2 => ReadingFlag::LowSignal,
            3 => ReadingFlag::Overload,
            _ => ReadingFlag::Normal,
        },
    }
}

const FIT: FitSettings = FitSettings {
    window_hz: [130.0, 260.0],
    noise: Some(FitNoise { at_ten_cycles: 0.005, degrees_of_freedom: 4.0 }),
    timing: FitTiming::Waited,
    always_loss: true,
    target_sigma_hz: None,
    near: None,
    bench: None,
};

/// A sweep of twelve readings. It was fitted with [`FIT`] if it is that of a touch.
pub(crate) fn sweep(number: u64, purpose: SweepPurpose, resonance_hz: f64) -> Sweep {
    let reading = |index| reading(resonance_hz, index);
    Sweep {
        number,
        purpose,
        step: Some(STEP.to_owned()),
        pose: Some(POSE),
        level_v: Some(5.0),
        readings: (0..12).map(reading).collect(),
        probe_readings: 0,
        fit: (purpose == SweepPurpose::Touch).then_some(FIT),
        outcome: SweepOutcome::Accepted {
            resonance_hz,
            sigma_hz: 0.02,
            effective_time_s: Some(1.25),
            circuit: Some(Circuit {
                quality_factor: 33.0,
                static_capacitance_f: 27.4e-9,
                capacitance_ratio: 0.08,
                loss_tangent: 0.018,
                loss_tangent_sigma: Some(0.000_41),
                quality_factor_sigma: Some(0.12),
                static_capacitance_sigma_f: Some(0.11e-9),
                capacitance_ratio_sigma: Some(0.000_7),
            }),
            extra: Some(Extra::Drift { change: 0.002 }),
            left_out: 1,
        },
    }
}
