//! Whether the contact sense can be trusted: the impedance of the clear probe against the last no-load
//! resonance, the surface against its neighbours, and the shift against nothing.
//!
//! A stuck sense feels a contact that is not there, a blind one feels none, and a stage that has lost
//! steps is not where its drive says. A touch that cannot be distinguished from these is refused.

pub(crate) mod response;
#[cfg(test)]
pub(crate) mod tests;

use rig_model::{ContactAngle, Impedance, Mm, PointResult, Position, Reading, RigLimits};
use rig_protocol::Approach;
use rig_resonance::{Circuit, Refusal, Resonance};

use crate::{
    Fault, TouchOutcome, TouchResult,
    listening::{CYCLES_MAX, cycles_needed},
    search::relative_change,
    slip::Slip,
    sweep::DRIFT,
};

/// The free resonance may have moved by this part since its last measurement: twice the drift that a
/// sweep expects, and less than the softest sample moves it at the depth of a touch.
const FREE_MOVE: f64 = 2.0 * DRIFT;

/// Resonances within that range with which the impedance is compared.
const FREE_STEPS: i32 = 40;

/// Largest deviation of the impedance of a free sensor from the nearest of them, relative. Noise is some
/// percent; a contact changes it by more than half. It is wider by the uncertainty of the capacitance,
/// which a short sweep knows to some ten percent only, up to the second limit.
const FREE_TOLERANCE: f64 = 0.35;
const FREE_TOLERANCE_MAX: f64 = 0.5;

/// A static capacitance whose standard deviation is below this part is taken as known; otherwise it may be
/// this many standard deviations off.
const KNOWN_CAPACITANCE: f64 = 0.03;
const CAPACITANCE_SIGMAS: i32 = 4;

/// The second frequency of the self-test lies this many linewidths below the no-load resonance, where the
/// impedance of the free sensor differs from that at the resonance by a multiple.
pub(crate) const TEST_LINEWIDTHS: f64 = 3.0;

/// A change is expected if it exceeds the noise of ten cycles by this factor.
const RESPONSE_NOISES: f64 = 10.0;

/// The quality of the free sensor is at least this part of the fitted one.
const LEAST_QUALITY_PART: f64 = 0.3;

/// A shift within this many standard deviations is none: the probe was pressed into the sample.
const NO_SHIFT_SIGMAS: f64 = 6.0;

/// The search felt the contact by a change of the impedance beyond its threshold. Deeper in the sample the change
/// is larger; one below this part of the threshold is none.
const NO_CHANGE_PART: f64 = 0.5;

/// A drift of this many standard deviations may change the impedance by this part of the threshold before a contact is
/// taken for one.
const DRIFT_SIGMAS: f64 = 3.0;
const DRIFT_PART: f64 = 0.5;

/// No search is begun if it changes more than this, in units of the threshold, between two readings.
const DRIFT_LIMIT: f64 = 2.0;

/// Time between two readings of a search that are compared, s: a step, its settling and its integration.
const BETWEEN_READINGS_S: f64 = 0.5;

/// How far a surface may be from where the touches before it on the same sample found it, as a part of
/// the surface tolerance of the rig.
const NEIGHBOUR_PART: f64 = 0.4;

/// Two readings of a live analyzer are never equal in every digit, if their noise is above this.
const ALIVE_NOISE: f64 = 1e-4;

/// The contact sense contradicts itself. The rig latches.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ContactSenseFault {
    /// The impedance of the clear probe is not that of the free sensor.
    #[error(
        "contact sense: at {frequency_hz:.3} Hz the impedance of the clear probe is {percent:.0} % from \
         that of the last no-load resonance, where at most {limit_percent:.0} % are allowed"
    )]
    NotFree {
        /// The frequency, Hz.
        frequency_hz: f64,
        /// Deviation from the nearest resonance within the drift, percent.
        percent: f64,
        /// Largest deviation, percent.
        limit_percent: f64,
    },
    /// The readings of the clear probe do not follow the frequency.
    #[error(
        "contact sense: from {from_hz:.3} Hz to {to_hz:.3} Hz the impedance of the clear probe changes \
         otherwise than the last no-load resonance says, by {percent:.0} % of that change, where at most \
         {limit_percent:.0} % are allowed"
    )]
    NoResponse {
        /// The first frequency, Hz.
        from_hz: f64,
        /// The second one, Hz.
        to_hz: f64,
        /// Deviation of the change from the expected one, percent.
        percent: f64,
        /// Largest deviation, percent.
        limit_percent: f64,
    },
    /// Two readings are equal in every digit.
    #[error("contact sense: two readings at {frequency_hz:.3} Hz are equal in every digit")]
    Frozen {
        /// The frequency, Hz.
        frequency_hz: f64,
    },
    /// The surface is not where the touches before found it.
    #[error(
        "the surface was found at {found}, {by_mm:.3} mm from where the touches before on this sample \
         expect it; at most {limit_mm:.3} mm are allowed"
    )]
    SurfaceMoved {
        /// The surface.
        found: Position<Mm>,
        /// Its distance from the expected place, mm.
        by_mm: f64,
        /// Largest distance, mm.
        limit_mm: f64,
    },
    /// The surface is so low that the touch would end below what the bench allows.
    #[error(
        "the surface was found at {found}, and the geometry of the rig file expects it at {expected}: a touch of \
         {depth_mm:.3} mm needs it at {lowest} or above"
    )]
    SurfaceTooLow {
        /// The surface.
        found: Position<Mm>,
        /// Where the geometry of the rig file expects it.
        expected: Position<Mm>,
        /// Depth of the touch, mm.
        depth_mm: f64,
        /// The lowest surface for this depth.
        lowest: Position<Mm>,
    },
    /// The contact threshold is too close to the noise.
    #[error(
        "contact sense: the noise of ten cycles is {noise_percent:.2} % of the impedance, and a change by \
         {threshold_percent:.1} % needs readings of {cycles:.0} cycles to be told from it, where at most \
         {cycles_max} are allowed"
    )]
    TooNoisy {
        /// Standard deviation of each part of a reading of ten cycles, percent.
        noise_percent: f64,
        /// The contact threshold of the protocol, percent.
        threshold_percent: f64,
        /// Cycles that are needed.
        cycles: f64,
        /// Largest number of cycles.
        cycles_max: u32,
    },
    /// The free resonance drifts so fast that a contact cannot be distinguished from it.
    #[error(
        "contact sense: the no-load resonance moves by {moved_hz:.2} Hz in {seconds:.1} s, as its measurements \
         show; three times that changes the impedance by {percent:.0} %, where at most {limit_percent:.0} %, twice \
         the contact threshold, are allowed"
    )]
    DriftsTooFast {
        /// Standard deviation of its way, Hz.
        moved_hz: f64,
        /// In this time, s.
        seconds: f64,
        /// Change of the impedance by three times that way, percent.
        percent: f64,
        /// Largest change, percent.
        limit_percent: f64,
    },
    /// The free resonance has moved too far.
    #[error(
        "contact sense: the no-load resonance moved from {from_hz:.2} Hz to {to_hz:.2} Hz, more than \
         {limit_percent:.0} %"
    )]
    ReferenceMoved {
        /// The last no-load resonance, Hz.
        from_hz: f64,
        /// The new one, Hz.
        to_hz: f64,
        /// Largest change, percent.
        limit_percent: f64,
    },
}

/// Why a touch has no trusted resonance.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TouchRefusal {
    /// The sweep was refused.
    #[error("{0}")]
    Sweep(Box<Refusal>),
    /// The probe was pressed into the sample, and the resonance is that of the free sensor.
    #[error(
        "no contact was felt at the depth of the touch: the shift is {shift_hz:.2} Hz ± {sigma_hz:.2} Hz, \
         and the impedance at {frequency_hz:.3} Hz changed by {percent:.1} %"
    )]
    NoShift {
        /// The shift, Hz.
        shift_hz: f64,
        /// Its standard deviation, Hz.
        sigma_hz: f64,
        /// The free resonance, Hz.
        frequency_hz: f64,
        /// Change of the impedance there, percent.
        percent: f64,
    },
    /// The surface was not where the search had found it, so that the depth is not known.
    #[error("{0}")]
    Slipped(Slip),
    /// What was measured next does not agree with it.
    #[error("it is contradicted by what was measured next: {0}")]
    Contradicted(Box<Fault>),
}

/// An impedance, ohm, at a frequency, Hz.
type Point = (f64, Impedance);

/// Holds the readings of the clear probe against the last no-load resonance: their impedance, and how it
/// follows the frequency. The last reading is the baseline; its impedance is returned, or `None` if the
/// analyzer flagged it.
pub(crate) fn check_free(
    no_load: &Resonance,
    readings: &[Reading],
) -> Result<Option<Impedance>, ContactSenseFault> {
    check_free_within(no_load, readings, |from_hz, to_hz| {
        response::tolerance(no_load, from_hz, to_hz)
    })
}

/// The same, with the part of the expected change of the impedance from one frequency to another by which it may
/// deviate.
fn check_free_within(
    no_load: &Resonance,
    readings: &[Reading],
    response_tolerance: impl Fn(f64, f64) -> f64,
) -> Result<Option<Impedance>, ContactSenseFault> {
    let valid = |reading: &Reading| match reading.measured {
        PointResult::Value(impedance) => Some((reading.frequency_hz, impedance)),
        _ => None,
    };
    let Some(baseline) = readings.last().and_then(valid) else { return Ok(None) };
    let other = readings.iter().filter_map(valid).rfind(|(hz, _)| *hz != baseline.0);
    if let Some(other) = other {
        check_alive(no_load, baseline.0, other.1, baseline.1)?;
    }
    let points: Vec<Point> = other.into_iter().chain([baseline]).collect();
    // The worst deviation of the readings from a possible free sensor with its frequency, and the deviation of
    // their difference.
    let compare = |circuit: Circuit| {
        let expected = |hz: f64| impedance(&circuit, hz);
        let deviation = |(hz, measured): &Point| {
            let expected = expected(*hz);
            (size_ohm(less(*measured, expected)) / size_ohm(expected), *hz)
        };
        let larger = |a: (f64, f64), b: (f64, f64)| if a.0 < b.0 { b } else { a };
        let worst = points.iter().map(deviation).fold((0.0, baseline.0), larger);
        let response = other.map_or(0.0, |(hz, one)| {
            let at_baseline = expected(baseline.0);
            let change = less(at_baseline, expected(hz));
            let measured = less(baseline.1, one);
            let noise = RESPONSE_NOISES * no_load.noise_at_ten_cycles;
            let noise_ohm = noise * size_ohm(at_baseline);
            size_ohm(less(measured, change)) / size_ohm(change).max(noise_ohm)
        });
        (worst, response)
    };
    let compared: Vec<((f64, f64), f64)> = free_sensors(no_load).map(compare).collect();
    let nearest = compared.iter().map(|(worst, _)| *worst).min_by(|a, b| a.0.total_cmp(&b.0));
    let (least, frequency_hz) = nearest.unwrap_or((f64::INFINITY, baseline.0));
    let tolerance = free_tolerance(no_load);
    if tolerance < least {
        let (percent, limit_percent) = (100.0 * least, 100.0 * tolerance);
        return Err(ContactSenseFault::NotFree { frequency_hz, percent, limit_percent });
    }
    let fitting = compared.iter().filter(|((worst, _), _)| *worst <= tolerance);
    let least = fitting.map(|(_, response)| *response).fold(f64::INFINITY, f64::min);
    let Some((from_hz, _)) = other else { return Ok(Some(baseline.1)) };
    let to_hz = baseline.0;
    let response_tolerance = response_tolerance(from_hz, to_hz);
    if response_tolerance < least {
        let (percent, limit_percent) = (100.0 * least, 100.0 * response_tolerance);
        return Err(ContactSenseFault::NoResponse { from_hz, to_hz, percent, limit_percent });
    }
    Ok(Some(baseline.1))
}

fn free_tolerance(no_load: &Resonance) -> f64 {
    let sigma = no_load.covariance[2][2].max(0.0).sqrt() / no_load.c0_farad;
    (FREE_TOLERANCE + sigma).min(FREE_TOLERANCE_MAX)
}

/// The magnitude of an impedance. Its square does not overflow, so that it takes a tenth of the time of
/// `hypot`, for hundreds of circuits.
fn size_ohm(impedance: Impedance) -> f64 {
    (impedance.resistance_ohm.powi(2) + impedance.reactance_ohm.powi(2)).sqrt()
}

fn impedance(circuit: &Circuit, hz: f64) -> Impedance {
    let impedance = circuit.impedance_ohm(hz);
    Impedance { resistance_ohm: impedance.re, reactance_ohm: impedance.im }
}

fn less(one: Impedance, other: Impedance) -> Impedance {
    Impedance {
        resistance_ohm: one.resistance_ohm - other.resistance_ohm,
        reactance_ohm: one.reactance_ohm - other.reactance_ohm,
    }
}

/// The free sensor as it may be now: its resonance within the drift, its quality and its capacitances within
/// their uncertainty.
fn free_sensors(no_load: &Resonance) -> impl Iterator<Item = Circuit> {
    let circuit = no_load.circuit();
    let covariance = &no_load.covariance;
    let sigma_q = covariance[1][1].max(0.0).sqrt();
    // The quality of a short sweep is known to some ten percent only.
    let qualities = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]
        .map(|sigmas: f64| sigmas.mul_add(sigma_q, circuit.q).max(LEAST_QUALITY_PART * circuit.q));
    // So is its static capacitance, with which the motional one and the loss go along.
    let sigma_c0 = covariance[2][2].max(0.0).sqrt();
    let is_known = sigma_c0 < KNOWN_CAPACITANCE * circuit.c0_farad;
    let capacitances = move |sigmas: i32| {
        let of = |value: usize| f64::from(sigmas) * covariance[value][2] / sigma_c0;
        let (c0_farad, c1_farad) = (circuit.c0_farad + of(2), circuit.c1_farad + of(3));
        let (least_c0, least_c1) = (0.5 * circuit.c0_farad, 0.5 * circuit.c1_farad);
        Circuit {
            c0_farad: c0_farad.max(least_c0),
            c1_farad: c1_farad.max(least_c1),
            loss_tangent: circuit.loss_tangent + of(4),
            ..circuit
        }
    };
    let reach = if is_known { 0 } else { CAPACITANCE_SIGMAS };
    let circuits = (-reach..=reach)
        .map(move |sigmas| if sigmas == 0 { circuit } else { capacitances(sigmas) });
    circuits.flat_map(move |circuit| {
        (-FREE_STEPS..=FREE_STEPS).flat_map(move |step| {
            let moved = 1.0 + FREE_MOVE * f64::from(step) / f64::from(FREE_STEPS);
            let resonance_hz = circuit.resonance_hz * moved;
            qualities.map(|q| Circuit { resonance_hz, q, ..circuit })
        })
    })
}

/// Refuses two readings of a noisy analyzer that are equal in every digit.
pub(crate) fn check_alive(
    no_load: &Resonance,
    frequency_hz: f64,
    one: Impedance,
    next: Impedance,
) -> Result<(), ContactSenseFault> {
    if one == next && ALIVE_NOISE < no_load.noise_at_ten_cycles {
        return Err(ContactSenseFault::Frozen { frequency_hz });
    }
    Ok(())
}

/// Refuses a reference whose noise hides a contact, and a free resonance that has moved further than any drift.
pub(crate) fn check_reference(
    last: Option<&Resonance>,
    now: &Resonance,
    approach: &Approach,
) -> Result<(), ContactSenseFault> {
    let Approach { contact_threshold, cycles: asked_cycles, .. } = *approach;
    let cycles = cycles_needed(now, contact_threshold);
    let cycles_max = CYCLES_MAX.max(asked_cycles);
    if f64::from(cycles_max) < cycles {
        let noise_percent = 100.0 * now.noise_at_ten_cycles;
        let threshold_percent = 100.0 * contact_threshold;
        return Err(ContactSenseFault::TooNoisy {
            noise_percent,
            threshold_percent,
            cycles,
            cycles_max,
        });
    }
    let Some(last) = last else { return Ok(()) };
    let (from_hz, to_hz) = (last.resonance_hz, now.resonance_hz);
    if (to_hz - from_hz).abs() <= FREE_MOVE * from_hz {
        return Ok(());
    }
    Err(ContactSenseFault::ReferenceMoved { from_hz, to_hz, limit_percent: 100.0 * FREE_MOVE })
}

/// Refuses a resonance in contact that is that of the free sensor, or of one that has drifted a little: it
/// changes the impedance by less than the contact that the search felt.
pub(crate) fn check_shift(
    no_load: &Resonance,
    loaded: &Resonance,
    contact_threshold: f64,
) -> Result<(), TouchRefusal> {
    let frequency_hz = no_load.resonance_hz;
    let shift_hz = loaded.resonance_hz - frequency_hz;
    let sigma_hz = loaded.sigma_hz.hypot(no_load.sigma_hz);
    let [free, in_contact] = [no_load, loaded].map(|fit| impedance(&fit.circuit(), frequency_hz));
    let change = relative_change(free, in_contact);
    if NO_SHIFT_SIGMAS * sigma_hz < shift_hz && NO_CHANGE_PART * contact_threshold < change {
        return Ok(());
    }
    let percent = 100.0 * change;
    Err(TouchRefusal::NoShift { shift_hz, sigma_hz, frequency_hz, percent })
}

/// Whether a drift of the free resonance, given by its standard deviation, can change the impedance so much that a
/// reading passes the threshold of a contact. The noise has half of the threshold for itself.
pub(crate) fn may_be_drift(no_load: &Resonance, moved_hz: f64, contact_threshold: f64) -> bool {
    DRIFT_PART * contact_threshold < drift_change(no_load, moved_hz)
}

/// Refuses a free resonance that drifts so fast that the next reading tells no contact from it.
pub(crate) fn check_drift(
    no_load: &Resonance,
    moves_hz: impl Fn(f64) -> f64,
    contact_threshold: f64,
) -> Result<(), ContactSenseFault> {
    let (seconds, moved_hz) = (BETWEEN_READINGS_S, moves_hz(BETWEEN_READINGS_S));
    let change = drift_change(no_load, moved_hz);
    let limit = DRIFT_LIMIT * contact_threshold;
    if change <= limit {
        return Ok(());
    }
    let (percent, limit_percent) = (100.0 * change, 100.0 * limit);
    Err(ContactSenseFault::DriftsTooFast { moved_hz, seconds, percent, limit_percent })
}

/// The relative change of the impedance by a large drift.
fn drift_change(no_load: &Resonance, moved_hz: f64) -> f64 {
    let frequency_hz = no_load.resonance_hz;
    let free = no_load.circuit();
    let drifted = Circuit { resonance_hz: frequency_hz + DRIFT_SIGMAS * moved_hz, ..free };
    let [free, drifted] = [free, drifted].map(|circuit| impedance(&circuit, frequency_hz));
    relative_change(free, drifted)
}

/// What the touches of a run say about each other.
#[derive(Debug, Default)]
pub(crate) struct Neighbours {
    /// How much higher than expected the surface of the present sample was found, mm.
    offsets_mm: Vec<f64>,
    /// The last measured touch, which nothing has confirmed yet.
    last: Option<TouchResult>,
    /// The last touch was on the present sample.
    is_same_sample: bool,
}

impl Neighbours {
    /// How much higher than expected the surface of the present sample lies, mm, as far as is known.
    pub(crate) fn offset_mm(&self) -> Option<f64> {
        let n = self.offsets_mm.len();
        (n > 0).then(|| self.offsets_mm.iter().sum::<f64>() / n as f64)
    }

    /// A person has changed the sample or the sensor.
    pub(crate) fn changed(&mut self) {
        self.offsets_mm.clear();
        self.is_same_sample = false;
    }

    /// A touch is finished, and confirms the one before it. `expected` is where the surface should have
    /// been.
    pub(crate) fn finished(&mut self, result: &TouchResult, expected: Position<Mm>) {
        let (TouchOutcome::Measured { contact, .. }
        | TouchOutcome::Refused { contact: Some(contact), .. }) = &result.outcome
        else {
            return;
        };
        self.offsets_mm.push(contact.surface.position.value() - expected.value());
        self.last = (!result.is_refused()).then(|| result.clone());
        self.is_same_sample = true;
    }

    /// Whether the last measured touch is still to be confirmed.
    pub(crate) const fn is_open(&self) -> bool {
        self.last.is_some()
    }

    /// The last touch has been confirmed.
    pub(crate) fn confirmed(&mut self) {
        self.last = None;
    }

    /// The last touch, refused, if a fault contradicts it: it is unknown since when the contact
    /// sense or the position has been wrong. At the end of a run nothing else can confirm it.
    pub(crate) fn contradicted_by(&mut self, fault: &Fault, is_end: bool) -> Option<TouchResult> {
        use ContactSenseFault::{
            Frozen, NoResponse, NotFree, ReferenceMoved, SurfaceMoved, SurfaceTooLow,
        };
        let is_contradiction = match fault {
            Fault::ContactSense(
                NotFree { .. } | NoResponse { .. } | Frozen { .. } | ReferenceMoved { .. },
            ) => true,
            Fault::NoReference { .. } if is_end => true,
            Fault::ContactSense(SurfaceMoved { .. } | SurfaceTooLow { .. })
            | Fault::NoContact { .. }
            | Fault::ContactTooEarly { .. }
            | Fault::NoReference { .. } => self.is_same_sample,
            _ => false,
        };
        let mut result = self.last.take_if(|_| is_contradiction)?;
        let TouchOutcome::Measured { contact, .. } = result.outcome else { return None };
        let refusal = TouchRefusal::Contradicted(Box::new(fault.clone()));
        result.outcome = TouchOutcome::Refused { contact: Some(contact), refusal };
        Some(result)
    }
}

/// Refuses a surface that is too low for a touch of this depth at this angle: it would end below the floor of the bench, which
/// the interlock in front of the ports keeps.
pub(crate) fn check_depth(
    found: Position<Mm>,
    expected: Position<Mm>,
    (depth_mm, angle): (f64, ContactAngle),
    limits: &RigLimits,
) -> Result<(), ContactSenseFault> {
    // Along the vertical, a surface that lies lower by t along its normal does so by t/cos α.
    let tolerance_mm = limits.geometry.surface_tolerance_mm / angle.radians().cos();
    let room_mm = tolerance_mm + limits.motion.max_indentation_mm - depth_mm;
    // The stage may be read back a little lower, and the sample at a slightly other tilt.
    let lowest = expected.offset(limits.linear.tolerance() - room_mm);
    if lowest <= found {
        return Ok(());
    }
    Err(ContactSenseFault::SurfaceTooLow { found, expected, depth_mm, lowest })
}

/// Refuses a surface that lies elsewhere than the touches before expect it.
pub(crate) fn check_surface(
    found: Position<Mm>,
    expected: Position<Mm>,
    offset_mm: Option<f64>,
    tolerance_mm: f64,
) -> Result<(), ContactSenseFault> {
    let Some(offset_mm) = offset_mm else { return Ok(()) };
    let by_mm = (found.value() - expected.value() - offset_mm).abs();
    let limit_mm = NEIGHBOUR_PART * tolerance_mm;
    if by_mm <= limit_mm {
        return Ok(());
    }
    Err(ContactSenseFault::SurfaceMoved { found, by_mm, limit_mm })
}
