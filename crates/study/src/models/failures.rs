//! Maps of the failures of tiers, contact laws and read-outs.

use rig_chart::{Category, HeatMap, Tone};
use rig_contact::{
    Contact, ContactLaw, Direction, Friction, Load, Models, Pose, Refusal, Sensor, Tier, Tissue,
};

use super::readout::ReadOut;
use crate::{
    files::Csv,
    page::Page,
    paper_bench::{Control, INDENTATION_MM, contact, tissue},
};

/// The grade of a cell of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Grade {
    Right,
    Doubtful,
    Wrong,
    Refused,
}

impl Grade {
    const ALL: [Self; 4] = [Self::Right, Self::Doubtful, Self::Wrong, Self::Refused];

    fn of(found: Option<f64>, expected: f64) -> Self {
        match found.map(|found| (found / expected - 1.0).abs()) {
            None => Self::Refused,
            Some(error) if error <= 0.01 => Self::Right,
            Some(error) if error <= 0.1 => Self::Doubtful,
            Some(_) => Self::Wrong,
        }
    }

    fn category(self) -> Category {
        let (name, tone, symbol) = match self {
            Self::Right => ("within 1 %", Tone::Good, ""),
            Self::Doubtful => ("within 10 %", Tone::Fair, "~"),
            Self::Wrong => ("beyond 10 %", Tone::Bad, "×"),
            Self::Refused => ("refused", Tone::None, "–"),
        };
        Category { name: name.to_owned(), tone, symbol: symbol.to_owned() }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Doubtful => "doubtful",
            Self::Wrong => "wrong",
            Self::Refused => "refused",
        }
    }
}

/// A map with a grade for each cell.
struct Map {
    file: &'static str,
    title: &'static str,
    x_label: &'static str,
    y_label: &'static str,
    columns: Vec<String>,
    rows: Vec<(&'static str, Vec<Grade>)>,
}

/// Adds every map, as chart and table.
pub(super) fn add(page: &mut Page) {
    page.heading("Failures of the models");
    page.text(
        "The difference from the reference with the exact contact, the worst of the three \
         directions: within 1 %, within 10 % (~), beyond (×), or refused (–). A tier or a law \
         refuses contacts outside its validity. T0 and T1 are wrong at an angle and do not refuse, \
         because they are the paper's own formula; `Tier::cheapest_for` does not choose them \
         there.",
    );
    for (text, map) in [
        (
            "Over the contact angle, for sample 3 at 0.5 mm. T1 is right upright and wrong from \
             30° on. Equation (7) is wrong even upright, because a straight line through the range \
             is low in the middle. T2 holds up to 75°, E1 up to 89.9°.",
            over_angle(),
        ),
        (
            "Over the stiffness of the contact relative to that of the sensor's tip, upright and so \
             shallow that the force turns no sensor. No \
             tier loses digits down to 1e-16; the error of the lumped tiers there is the slope of \
             a line that was fitted elsewhere. Beyond 10 the mode shape changes, and they refuse.",
            over_ratio(),
        ),
        (
            "Contact laws over the depth. At two radii the top of the ball is level with the \
             surface. Beyond, the radius by equation (4) would fall, and be imaginary beyond four \
             radii.",
            over_depth(),
        ),
        (
            "Over the loss of the tissue. The tiers hold; the read-outs of an impedance curve \
             fail, zero phase first.",
            over_loss(),
        ),
        (
            "Over friction. A contact that would slip is refused. The paper's coefficient of 0.1 \
             holds up to 8.5°.",
            over_friction(),
        ),
    ] {
        page.text(text);
        let mut table = Csv::new(&["row", "column", "grade"]);
        for (row, grades) in &map.rows {
            for (column, grade) in map.columns.iter().zip(grades) {
                table.row([*row, column.as_str(), grade.name()]);
            }
        }
        page.chart(&format!("{}.svg", map.file), map.chart());
        page.data(&format!("{}.csv", map.file), table.text());
    }
}

impl Map {
    fn chart(&self) -> HeatMap {
        let index = |grade: &Grade| {
            Grade::ALL.iter().position(|one| one == grade).expect("every grade is listed")
        };
        HeatMap {
            title: self.title.to_owned(),
            description: format!(
                "{}: each cell grades the row at the column's value, against the reference with \
                 the exact contact.",
                self.title
            ),
            x_label: self.x_label.to_owned(),
            y_label: self.y_label.to_owned(),
            columns: self.columns.clone(),
            rows: self.rows.iter().map(|(row, _)| (*row).to_owned()).collect(),
            categories: Grade::ALL.map(Grade::category).to_vec(),
            cells: self.rows.iter().flat_map(|(_, grades)| grades.iter().map(index)).collect(),
        }
    }
}

fn models() -> Models {
    Models::new(&Sensor::reference(), ContactLaw::Sneddon)
}

fn shift(models: &Models, tier: Tier, tissue: &Tissue, contact: &Contact) -> Result<f64, Refusal> {
    models.predict(tier, tissue, contact).map(|found| found.shift_hz)
}

/// Tiers with different models of the beam, without stage moves.
const TIERS: [Tier; 7] =
    [Tier::T0, Tier::T0b, Tier::T1, Tier::T2, Tier::E1, Tier::Exact, Tier::Reference];

fn over_angle() -> Map {
    let models = models();
    let angles = [0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0, 89.9];
    let tissue = tissue(0.235);
    let depth = Control::Indentation.depth(INDENTATION_MM);
    let worst = |tier: Tier, angle_deg: f64| {
        let grades = Direction::ALL.map(|direction| {
            let contact = contact(direction, angle_deg, depth, ContactLaw::Sneddon);
            let expected = shift(&models, Tier::Reference, &tissue, &contact)
                .expect("sticking contacts of this depth exist at every angle");
            Grade::of(shift(&models, tier, &tissue, &contact).ok(), expected)
        });
        worst_of(grades)
    };
    Map {
        file: "failures-angle",
        title: "Tiers over the contact angle",
        x_label: "contact angle, °",
        y_label: "tier",
        columns: angles.map(|angle| angle.to_string()).to_vec(),
        rows: TIERS
            .map(|tier| (tier.name(), angles.map(|angle| worst(tier, angle)).to_vec()))
            .to_vec(),
    }
}

/// The worst of the grades. A wrong result is worse than a refusal.
fn worst_of<const N: usize>(grades: [Grade; N]) -> Grade {
    [Grade::Wrong, Grade::Refused, Grade::Doubtful]
        .into_iter()
        .find(|grade| grades.contains(grade))
        .unwrap_or(Grade::Right)
}

/// So shallow that the force of the stiffest contact turns no sensor, mm.
const SHALLOW_MM: f64 = 1e-6;

fn over_ratio() -> Map {
    let models = models();
    let ratios = [1e-16, 1e-8, 1e-4, 1e-2, 0.1, 0.5, 1.0, 3.0, 5.0, 10.0, 30.0, 1e2, 1e3, 1e6];
    let contact =
        contact(Direction::Front, 0.0, Control::Indentation.depth(SHALLOW_MM), ContactLaw::Sneddon);
    let unit = ratio_of_one_mpa(&models, &contact);
    let grade = |tier: Tier, ratio: f64| {
        let shift = |tier| shift(&models, tier, &tissue(ratio / unit), &contact).ok();
        // Beyond the reference only the exact beam holds.
        let expected = shift(Tier::Reference).or(shift(Tier::Exact)).unwrap_or(f64::NAN);
        Grade::of(shift(tier), expected)
    };
    Map {
        file: "failures-stiffness-ratio",
        title: "Tiers over the stiffness of the contact",
        x_label: "contact over sensor stiffness",
        y_label: "tier",
        columns: ratios.map(short).to_vec(),
        rows: TIERS
            .map(|tier| (tier.name(), ratios.map(|ratio| grade(tier, ratio)).to_vec()))
            .to_vec(),
    }
}

/// A number as short as it can be written, so that a column is not wider than its mark.
fn short(value: f64) -> String {
    if (1e-2..1e3).contains(&value) { value.to_string() } else { format!("{value:e}") }
}

fn ratio_of_one_mpa(models: &Models, contact: &Contact) -> f64 {
    let load: Load =
        models.sensor().load(&tissue(1.0), contact).expect("the contact is within its law");
    models.stiffness_ratio(&load)
}

fn over_depth() -> Map {
    let depths = [1e-12, 1e-6, 1e-3, 0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 2.001, 4.0, 4.001];
    let laws = [
        ContactLaw::Paper,
        ContactLaw::Hertz,
        ContactLaw::SneddonSeries,
        ContactLaw::NeoHookean,
        ContactLaw::Sneddon,
    ];
    let radius = |law: ContactLaw, depth: f64| law.at(depth).ok().map(|patch| patch.radius_rel);
    let grade = |law: ContactLaw, depth: f64| {
        // Outside the range of Sneddon's solution there is no reference.
        radius(ContactLaw::Sneddon, depth)
            .map_or(Grade::Refused, |expected| Grade::of(radius(law, depth), expected))
    };
    Map {
        file: "failures-depth",
        title: "Contact laws over the depth, against Sneddon's solution",
        x_label: "depth over ball radius",
        y_label: "contact law",
        columns: depths.map(short).to_vec(),
        rows: laws.map(|law| (law.name(), depths.map(|depth| grade(law, depth)).to_vec())).to_vec(),
    }
}

fn over_loss() -> Map {
    let models = models();
    let losses = [0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0];
    let contact = contact(
        Direction::Front,
        0.0,
        Control::Indentation.depth(INDENTATION_MM),
        ContactLaw::Sneddon,
    );
    let clear = Contact::new(Pose::UPRIGHT, Control::Indentation.depth(0.0));
    let lossy =
        |loss: f64| Tissue::new(0.235, 0.5, loss).expect("the map's losses are within their range");
    let expected = |loss: f64| {
        shift(&models, Tier::Reference, &lossy(loss), &contact).expect("the reference answers")
    };
    let read = |read_out: ReadOut, loss: f64| {
        let hz = |contact: &Contact| {
            let circuit = models.circuit(Tier::Reference, &lossy(loss), contact).ok()?;
            read_out.read_hz(circuit.series_resonance_hz, |f| circuit.admittance_s(f))
        };
        Some(hz(&contact)? - hz(&clear)?)
    };
    let mut rows: Vec<(&str, Vec<Grade>)> = [Tier::T2, Tier::E1, Tier::Exact]
        .map(|tier| {
            let grade = |loss: f64| {
                let found = shift(&models, tier, &lossy(loss), &contact).ok();
                Grade::of(found, expected(loss))
            };
            (tier.name(), losses.map(grade).to_vec())
        })
        .to_vec();
    for read_out in ReadOut::ALL {
        let grades = losses.map(|loss| Grade::of(read(read_out, loss), expected(loss)));
        rows.push((read_out.name(), grades.to_vec()));
    }
    Map {
        file: "failures-damping",
        title: "Tiers and read-outs over the loss of the tissue, sample 3",
        x_label: "loss factor of the tissue",
        y_label: "tier or read-out",
        columns: losses.map(|loss| loss.to_string()).to_vec(),
        rows,
    }
}

fn over_friction() -> Map {
    let models = models();
    let coefficients = [0.0, 0.05, 0.1, 0.2, 0.3, 0.385, 0.5, 0.667, 0.8, 1.0];
    let angles: [(&str, f64); 7] = [
        ("0°", 0.0),
        ("5°", 5.0),
        ("8.5°", 8.5),
        ("15°", 15.0),
        ("30°", 30.0),
        ("45°", 45.0),
        ("60°", 60.0),
    ];
    let tissue = tissue(0.235);
    let grade = |angle_deg: f64, coefficient: f64| {
        let depth = Control::Indentation.depth(INDENTATION_MM);
        let sticking = contact(Direction::Back, angle_deg, depth, ContactLaw::Sneddon);
        let expected = shift(&models, Tier::Reference, &tissue, &sticking)
            .expect("sticking contacts of this depth exist at every angle");
        let held = Contact { friction: Friction::Coulomb { coefficient }, ..sticking };
        Grade::of(shift(&models, Tier::E1, &tissue, &held).ok(), expected)
    };
    Map {
        file: "failures-friction",
        title: "Where the contact sticks: tier E1 over friction and angle",
        x_label: "coefficient of friction",
        y_label: "contact angle",
        columns: coefficients.map(|coefficient| coefficient.to_string()).to_vec(),
        rows: angles
            .map(|(name, angle)| (name, coefficients.map(|mu| grade(angle, mu)).to_vec()))
            .to_vec(),
    }
}
