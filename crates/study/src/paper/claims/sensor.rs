//! Claims on the sensor and its simulation.

use rig_contact::{Circuit, Contact, ContactLaw, Direction, Models, Sensor, SensorDesign, Tier};

use super::{Assessment, Claim, claim};
use crate::{
    models::readout::ReadOut,
    paper::figures::noiseless,
    paper_bench::{Control, SAMPLES_MPA, tissue},
};

pub(super) fn claims() -> Vec<Claim> {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    [shifts(&models), simulation(&models), bench(&models)].concat()
}

/// Claims on the shift over stiffness and angle.
fn shifts(models: &Models) -> Vec<Claim> {
    let simulation = noiseless(models, Tier::Reference, Control::Indentation);
    let mean = |young: f64, angle: f64| {
        Direction::ALL
            .iter()
            .map(|&direction| simulation.exact_hz(young, direction, angle))
            .sum::<f64>()
            / 3.0
    };
    let fall = |sample: usize| {
        let young = SAMPLES_MPA[sample];
        (mean(young, 0.0) - mean(young, 45.0), 1.0 - mean(young, 45.0) / mean(young, 0.0))
    };
    let ((soft_hz, soft), (hard_hz, hard)) = (fall(0), fall(4));
    let slope = |young: f64| (mean(young * 1.01, 0.0) - mean(young * 0.99, 0.0)) / (0.02 * young);
    vec![
        claim(
            "section 3.1.1",
            "sensitivity 134.11 Hz/MPa with 140.4 Hz without contact",
            Assessment::HoldsInPart,
            format!(
                "possible: two facts for two unknowns (width and mass); but then the shift is \
                 concave: {:.0} Hz/MPa at 0.045 MPa, {:.0} at 0.649, {:.0} at 1",
                slope(0.045),
                slope(0.649),
                slope(1.0)
            ),
        ),
        claim(
            "section 3.2",
            "the softer the lump, the smaller the influence of the angle",
            Assessment::HoldsInPart,
            format!(
                "in hertz ({soft_hz:.2} Hz for sample 1, {hard_hz:.2} Hz for sample 5); relative \
                 to the shift it is the opposite ({:.1} % and {:.1} %)",
                100.0 * soft,
                100.0 * hard
            ),
        ),
    ]
}

/// Claims on the simulation.
fn simulation(models: &Models) -> Vec<Claim> {
    let simulation = noiseless(models, Tier::Reference, Control::Indentation);
    let swing = |young: f64, depth_mm: f64| {
        let contact = Contact {
            depth: Control::Indentation.depth(depth_mm),
            ..simulation.contact(Direction::Front, 0.0)
        };
        let circuit = models.circuit(Tier::Reference, &tissue(young), &contact);
        ball_swing_mm(models.sensor().design(), &circuit.expect("within the law"), 5.0)
    };
    let stiffest = tissue(SAMPLES_MPA[4]);
    let curve = |depth_mm: f64, read_out: ReadOut| {
        let contact = Contact {
            depth: Control::Indentation.depth(depth_mm),
            ..simulation.contact(Direction::Front, 0.0)
        };
        let circuit = models.circuit(Tier::Reference, &stiffest, &contact).expect("within the law");
        read_out
            .read_hz(circuit.series_resonance_hz, |f| circuit.admittance_s(f))
            .expect("these impedances have an extreme")
    };
    let shift = |read_out| curve(0.5, read_out) - curve(0.0, read_out);
    let read = |read_out| shift(read_out) - shift(ReadOut::Conductance);
    vec![
        claim(
            "section 3.1.1",
            "at 5 V the vibration is much smaller than the indentation",
            Assessment::Undecided,
            format!(
                "the damping is not printed; with the losses assumed here (quality factor {:.0}) \
                 the amplitude of the ball would be {:.2} mm without contact, {:.2} mm on sample 1 \
                 and {:.2} mm on sample 5, at an indentation of 0.5 mm; a tenth of the voltage \
                 would suffice",
                models.sensor().design().beam_loss.recip(),
                swing(SAMPLES_MPA[0], 0.0),
                swing(SAMPLES_MPA[0], 0.5),
                swing(SAMPLES_MPA[4], 0.5)
            ),
        ),
        claim(
            "section 3.1.1",
            "the impedance curve records the resonance",
            Assessment::Undecided,
            format!(
                "the text does not say which point of the curve: against the peak of the \
                 conductance, the largest impedance changes the shift of sample 5 by {:+.1} Hz and \
                 the smallest by {:+.1} Hz, and zero phase does not occur",
                read(ReadOut::GreatestImpedance),
                read(ReadOut::LeastImpedance)
            ),
        ),
        claim(
            "section 2.2.2",
            "Poisson's ratio of tissue: \"0.7 to 0.99\", and \"around 0.5\"",
            Assessment::HoldsInPart,
            "no isotropic material has more than 0.5, the value for equation (1); the range is at \
             best that of the anisotropy factor",
        ),
    ]
}

/// Amplitude of the ball at resonance, mm.
///
/// The motional charge of the electrodes gives the slope at the end of the beam. The shape of the
/// first bending mode with a mass at its end, φ L/w = 1.5, gives the deflection.
fn ball_swing_mm(design: &SensorDesign, circuit: &Circuit, volts: f64) -> f64 {
    let arm_m = 0.5e-3 * (design.piezo_thickness_mm + design.core_thickness_mm);
    let moment_n_m_per_v = 2.0 * design.piezo.coupling_c_per_m2 * design.width_mm * 1e-3 * arm_m;
    let charge_c = volts * circuit.capacitance_f * circuit.capacitance_ratio * circuit.q;
    charge_c / moment_n_m_per_v * design.length_mm / 1.5
}

/// Claims on the contact.
fn bench(models: &Models) -> Vec<Claim> {
    let simulation = noiseless(models, Tier::Reference, Control::Indentation);
    let contact = |young: f64| {
        let contact = simulation.contact(Direction::Front, 0.0);
        let load = models.sensor().load(&tissue(young), &contact).expect("within the law");
        load.normal_n_per_m
    };
    let stage = {
        let contact =
            noiseless(models, Tier::Reference, Control::Stage).contact(Direction::Front, 0.0);
        let load = models.sensor().load(&tissue(SAMPLES_MPA[4]), &contact);
        load.expect("within the law").depth_mm
    };
    vec![
        claim(
            "section 2.2.2",
            "no slip between 0° and 45°",
            Assessment::DoesNotHold,
            format!(
                "with the friction of 0.1 of section 3.1.1 a ball pressed in along the probe \
                 sticks up to tan α = μ/τ, {:.2}°; 45° needs a friction of {:.3}",
                (0.1_f64 / (2.0 / 3.0)).atan().to_degrees(),
                2.0 / 3.0
            ),
        ),
        claim(
            "section 3.2",
            "the stage ensures an indentation of 0.5 mm",
            Assessment::DoesNotHold,
            format!(
                "a sensor with 134.11 Hz/MPa has 433 N/m at its ball, and the contact {:.0} to \
                 {:.0} N/m: a stage move of 0.5 mm indents sample 5 by {stage:.2} mm; the paper \
                 does not mention it",
                contact(SAMPLES_MPA[0]),
                contact(SAMPLES_MPA[4])
            ),
        ),
        claim(
            "Figure 8",
            "(35, 0.5) has the best D1 and D1/D2",
            Assessment::DoesNotHold,
            "in Figure 8 below, D1 of the shorter sensor is smaller in every vibrating model; only \
             T1 gives the paper's order of D1/D2",
        ),
        claim(
            "Figures 6, 11",
            "the direction has no significant influence",
            Assessment::Undecided,
            "true for a sticking contact with an arm of 1 to 2 mm, or for a stiffer sideways one; \
             with 8 mm front and back differ by 15 to 20 % at 45° (Figure 6 below); the arm is not \
             printed",
        ),
    ]
}
