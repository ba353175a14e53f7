//! Values of the engine in the types of the journal.

use rig_engine::{Descended, FinishedSweep, RunStatus};
use rig_model::{Clearance, Direction, Mm, Position, Reading, ReadingFlag, RigTime};
use rig_protocol::{Phase, Pose};
use rig_resonance::{Circuit, Extra, Onset, Past, Timing};
use rig_store as store;

pub(super) const fn ending_of(status: RunStatus) -> store::Ending {
    match status {
        RunStatus::Completed => store::Ending::Completed,
        RunStatus::CompletedWithRefusals => store::Ending::CompletedWithRefusals,
        RunStatus::Aborted => store::Ending::Aborted,
        RunStatus::Faulted => store::Ending::Faulted,
    }
}

pub(super) fn pose_of(pose: Pose) -> store::Pose {
    let direction = match pose.direction {
        Direction::Front => store::Direction::Front,
        Direction::Back => store::Direction::Back,
        Direction::Left => store::Direction::Left,
    };
    store::Pose { direction, angle_deg: pose.angle.degrees() }
}

pub(super) const fn phase_of(phase: Phase) -> store::Phase {
    match phase {
        Phase::Main => store::Phase::Main,
        Phase::Blind => store::Phase::Blind,
    }
}

pub(super) const fn clearance_of(clearance: Clearance) -> store::Clearance {
    match clearance {
        Clearance::Clear => store::Clearance::Clear,
        Clearance::InContact => store::Clearance::InContact,
        Clearance::Unknown => store::Clearance::Unknown,
    }
}

pub(super) fn tried((position, reading): &(Position<Mm>, Reading)) -> store::SurfaceReading {
    store::SurfaceReading { position_mm: position.value(), reading: reading_of(reading) }
}

pub(super) fn descent_of(step: String, pose: store::Pose, descended: &Descended) -> store::Descent {
    let way_point = |(at, position): &(RigTime, Position<Mm>)| store::WayPoint {
        at_s: at.as_seconds(),
        position_mm: position.value(),
    };
    store::Descent {
        step,
        pose,
        target_mm: descended.target.value(),
        speed_mm_per_s: descended.speed_mm_per_s,
        read_back_mm: descended.read_back.value(),
        end: descended.end.name().to_owned(),
        way: descended.way.iter().map(way_point).collect(),
        readings: descended.readings.iter().map(reading_of).collect(),
    }
}

pub(super) const fn onset_of(onset: &Onset) -> store::Onset {
    store::Onset {
        latency_s: onset.latency.mean_s,
        latency_sigma_s: onset.latency.sigma_s,
        mm_per_latency_s: onset.mm_per_latency_s,
        exponent: onset.exponent,
        chi_squared_per_dof: onset.chi_squared_per_dof,
    }
}

pub(super) fn circuit_of(circuit: &Circuit) -> store::Circuit {
    store::Circuit {
        quality_factor: circuit.q,
        static_capacitance_f: circuit.c0_farad,
        capacitance_ratio: circuit.c1_farad / circuit.c0_farad,
        loss_tangent: circuit.loss_tangent,
        loss_tangent_sigma: None,
        quality_factor_sigma: None,
        static_capacitance_sigma_f: None,
        capacitance_ratio_sigma: None,
    }
}

/// What was fitted together with a circuit.
pub(super) const fn extra_of(extra: &Extra) -> store::Extra {
    match *extra {
        Extra::Drift { change } => store::Extra::Drift { change },
        Extra::Relaxation { change, time_s } => store::Extra::Relaxation { change, time_s },
        Extra::Stray { resistance_ohm, inductance_h } => {
            store::Extra::Stray { resistance_ohm, inductance_h }
        }
        Extra::SecondMode { resonance_hz, q, capacitance_farad } => store::Extra::SecondMode {
            resonance_hz,
            quality_factor: q,
            capacitance_f: capacitance_farad,
        },
        Extra::Dispersion { slope } => store::Extra::Dispersion { slope },
        Extra::AnalyzerPhase { phase_rad } => store::Extra::AnalyzerPhase { phase_rad },
    }
}

/// The inputs of the fit of a sweep; every planner has its window.
pub(super) fn fit_settings(outcome: &FinishedSweep) -> Option<store::FitSettings> {
    let options = &outcome.fit;
    let window = options.window?;
    Some(store::FitSettings {
        window_hz: [window.min_hz, window.max_hz],
        noise: options.noise.map(|noise| store::FitNoise {
            at_ten_cycles: noise.at_ten_cycles,
            degrees_of_freedom: noise.degrees_of_freedom,
        }),
        timing: match options.timing {
            Timing::Unknown => store::FitTiming::Unknown,
            Timing::Waited => store::FitTiming::Waited,
            Timing::Exact(Past::Unknown) => store::FitTiming::Exact,
            Timing::Exact(Past::Rest) => store::FitTiming::ExactFromRest,
            Timing::AnyPhase => store::FitTiming::AnyPhase,
        },
        always_loss: options.always_loss,
        target_sigma_hz: outcome.target_hz,
        near: options.near.map(|near| store::NearCircuit {
            resonance_hz: near.resonance_hz,
            circuit: circuit_of(&near),
        }),
        bench: options.bench.map(|bench| store::BenchSettings {
            phase_rad: bench.phase_rad,
            phase_sigma_rad: bench.phase_sigma_rad,
            first_gap_s: bench.first_gap_s,
            dispersion_f: bench.dispersion_farad,
            dispersion_sigma_f: bench.dispersion_sigma_farad,
            mode_sigma: bench.mode_sigma,
            surveyed_hz: [bench.surveyed.min_hz, bench.surveyed.max_hz],
        }),
    })
}

pub(super) fn reading_of(reading: &Reading) -> store::ReadingRecord {
    let impedance = reading.impedance();
    store::ReadingRecord {
        frequency_hz: reading.frequency_hz,
        resistance_ohm: impedance.map(|impedance| impedance.resistance_ohm),
        reactance_ohm: impedance.map(|impedance| impedance.reactance_ohm),
        started_s: reading.started.as_seconds(),
        settle_s: reading.settle_s,
        integration_s: reading.integration_s,
        flag: match reading.flag() {
            None => store::ReadingFlag::Normal,
            Some(ReadingFlag::Overload) => store::ReadingFlag::Overload,
            Some(ReadingFlag::LowSignal) => store::ReadingFlag::LowSignal,
        },
    }
}

/// A count as a record holds it. A plan of four thousand million steps is refused long before.
pub(super) fn size(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}
