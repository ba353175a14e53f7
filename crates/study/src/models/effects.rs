//! The size of each effect on a shift: the error of a model that neglects it.

use rig_contact::{
    Contact, ContactLaw, Direction, Friction, Load, Models, Pose, Sensor, SensorDesign, Tier,
    Tissue,
    equations::{TissueConstants, TissueImpedance},
};

use super::readout::ReadOut;
use crate::{
    files::Csv,
    page::{Page, Table},
    paper_bench::{Control, INDENTATION_MM, SAMPLES_MPA, contact, tissue},
};

/// The contact against which every effect is measured.
struct Baseline {
    models: Models,
    tissue: Tissue,
    contact: Contact,
    shift_hz: f64,
}

/// Adds the table of effects: all of it as data, sample 5 as a table.
pub(super) fn add(page: &mut Page) {
    page.heading("The size of each effect");
    page.text(
        "The change of a shift in hertz for one change of the model, for sample 5 at 0.5 mm; all \
         else stays, including the constants of the sensor. Effects of about a tenth of a hertz or \
         less (mass and loss of the tissue, lateral bending) are modelled by the reference only, \
         or not at all. An empty cell means that the impedance curve has no such read-out.",
    );
    let cases = [
        (Direction::Front, 0.0),
        (Direction::Front, 45.0),
        (Direction::Back, 45.0),
        (Direction::Left, 45.0),
    ];
    let mut all =
        Csv::new(&["effect", "sample", "direction", "angle_deg", "shift_hz", "change_hz"]);
    let mut shown = Table::new(&["effect", "0°, Hz", "45° front", "45° back", "45° left"]);
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    for sample in [0, 2, 4] {
        let columns = cases.map(|(direction, angle_deg)| {
            let depth = Control::Indentation.depth(INDENTATION_MM);
            let contact = contact(direction, angle_deg, depth, ContactLaw::Sneddon);
            let tissue = tissue(SAMPLES_MPA[sample]);
            let shift_hz = shift(&models, &tissue, &contact);
            let effects = effects(&Baseline { models, tissue, contact, shift_hz });
            for (effect, changed_hz) in &effects {
                all.row([
                    (*effect).to_owned(),
                    (sample + 1).to_string(),
                    direction.name().to_owned(),
                    angle_deg.to_string(),
                    format!("{shift_hz:.3}"),
                    change(*changed_hz, shift_hz, 3),
                ]);
            }
            effects
                .into_iter()
                .map(|(effect, changed_hz)| (effect, change(changed_hz, shift_hz, 2)))
                .collect::<Vec<_>>()
        });
        if sample == 4 {
            for (index, (effect, _)) in columns[0].iter().enumerate() {
                let changes = columns.each_ref().map(|column| column[index].1.clone());
                shown.row([(*effect).to_owned()].into_iter().chain(changes));
            }
        }
    }
    page.table(shown);
    page.data("effects.csv", all.text());
}

/// The change of a shift; empty for a read-out that does not exist.
fn change(changed_hz: Option<f64>, shift_hz: f64, decimals: usize) -> String {
    let Some(hz) = changed_hz else { return String::new() };
    let text = format!("{:+.decimals$}", hz - shift_hz);
    // A zero has no sign.
    if text.trim_start_matches(['+', '-', '0', '.']).is_empty() {
        return text.trim_start_matches(['+', '-']).to_owned();
    }
    text
}

fn shift(models: &Models, tissue: &Tissue, contact: &Contact) -> f64 {
    models
        .predict(Tier::Reference, tissue, contact)
        .expect("the effects' contacts are within Sneddon's solution")
        .shift_hz
}

/// Each effect with the changed shift.
fn effects(base: &Baseline) -> Vec<(&'static str, Option<f64>)> {
    let Baseline { models, tissue, contact, shift_hz } = base;
    let with_contact = |changed: Contact| Some(shift(models, tissue, &changed));
    let with_tissue = |poisson: f64, loss: f64| {
        let changed =
            Tissue::new(tissue.young_mpa(), poisson, loss).expect("the effects' tissues exist");
        Some(shift(models, &changed, contact))
    };
    let with_law = |law| with_contact(Contact { law, ..*contact });
    let no_arm = {
        let design = SensorDesign { arm_mm: 0.0, ..SensorDesign::reference() };
        let sensor = Sensor::new(design).expect("a probe without an arm can be built");
        Some(shift(&Models::new(&sensor, ContactLaw::Sneddon), tissue, contact))
    };
    let in_plane = models.predict(Tier::Exact, tissue, contact).ok().map(|found| found.shift_hz);
    let load = models.sensor().load(tissue, contact).expect("the effects' contacts have a load");
    let forceless = Load { force_n: 0.0, ..load };
    let mut effects = vec![
        (
            "no static force",
            Some(models.shift_of_load(Tier::Reference, tissue, &contact.pose, &forceless)),
        ),
        (
            "stage held instead of indentation",
            with_contact(Contact { depth: Control::Stage.depth(INDENTATION_MM), ..*contact }),
        ),
        ("no friction", with_contact(Contact { friction: Friction::Frictionless, ..*contact })),
        ("Hertz radius", with_law(ContactLaw::Hertz)),
        ("paper radius", with_law(ContactLaw::Paper)),
        ("neo-Hookean stiffness", with_law(ContactLaw::NeoHookean)),
        ("no probe arm", no_arm),
        ("Poisson's ratio 0.45", with_tissue(0.45, tissue.loss())),
        ("no tissue loss", with_tissue(tissue.poisson(), 0.0)),
        ("tissue loss 0.3", with_tissue(tissue.poisson(), 0.3)),
        ("no lateral bending and no losses", in_plane),
        ("mass of the tissue with a11 = 1", Some(shift_hz * (1.0 - mass_share(base)))),
        ("electrodes open", open_circuit(base)),
    ];
    for read_out in ReadOut::ALL {
        effects.push((read_out.name(), read(base, read_out)));
    }
    effects
}

/// The share of the shift that the mass in equation (1) takes: ω² times mass over stiffness.
fn mass_share(base: &Baseline) -> f64 {
    let load =
        base.models.sensor().load(&base.tissue, &base.contact).expect("the baseline has a load");
    let radius_m = load.radius_mm * 1e-3;
    let constants = TissueConstants {
        young_pa: base.tissue.young_mpa() * 1e6,
        poisson: base.tissue.poisson(),
        density_kg_per_m3: 1000.0,
        mass_factor: 1.0,
        resistance_factor: 0.0,
    };
    let impedance = TissueImpedance::of(&constants, std::f64::consts::PI * radius_m * radius_m);
    let omega = std::f64::consts::TAU * (base.models.no_load_hz(Tier::Reference) + base.shift_hz);
    omega * omega * impedance.mass_kg / impedance.stiffness_n_per_m
}

/// The circuit of the reference in contact and free.
fn circuits(base: &Baseline) -> Option<[rig_contact::Circuit; 2]> {
    let clear = Contact::new(Pose::UPRIGHT, Control::Indentation.depth(0.0));
    let circuit = |contact| base.models.circuit(Tier::Reference, &base.tissue, contact).ok();
    Some([circuit(&base.contact)?, circuit(&clear)?])
}

/// The shift of the resonance with open electrodes, fs √(1 + C₁/C₀).
fn open_circuit(base: &Baseline) -> Option<f64> {
    let [touching, free] = circuits(base)?
        .map(|circuit| circuit.series_resonance_hz * (1.0 + circuit.capacitance_ratio).sqrt());
    Some(touching - free)
}

/// The shift by a read-out, in contact and free.
fn read(base: &Baseline, read_out: ReadOut) -> Option<f64> {
    let [touching, free] = circuits(base)?.map(|circuit| {
        read_out.read_hz(circuit.series_resonance_hz, |frequency| circuit.admittance_s(frequency))
    });
    Some(touching? - free?)
}
