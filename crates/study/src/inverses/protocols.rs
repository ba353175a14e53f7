//! Protocols with several touches of one site at an unknown angle.

use std::f64::consts::FRAC_PI_4;

use rig_contact::{
    Contact, ContactLaw, Friction, Models, Pose, Sensor, Tier,
    inverse::{
        AnglePrior, AzimuthPrior, ShiftSigmas, SiteTouch, TissueKind, TouchModel, infer_tilt,
    },
};

use crate::{
    page::{Page, Table},
    paper_bench::{Control, SAMPLES_MPA, tissue},
};

/// One touch of a protocol.
struct Spin {
    spin_deg: f64,
    indentation_mm: f64,
}

const fn spin(spin_deg: f64, indentation_mm: f64) -> Spin {
    Spin { spin_deg, indentation_mm }
}

/// A protocol of touches of one site.
struct Protocol {
    name: &'static str,
    touches: &'static [Spin],
    azimuth: AzimuthPrior,
}

/// A surface that leans to the back at zero spin.
const BACK: AzimuthPrior = AzimuthPrior::Known(std::f64::consts::PI);

const PROTOCOLS: [Protocol; 6] = [
    Protocol { name: "one touch, azimuth known", touches: &[spin(0.0, 0.5)], azimuth: BACK },
    Protocol {
        name: "depths 0.25 and 0.5 mm, azimuth known",
        touches: &[spin(0.0, 0.25), spin(0.0, 0.5)],
        azimuth: BACK,
    },
    Protocol {
        name: "depths 0.25 and 1 mm, azimuth known",
        touches: &[spin(0.0, 0.25), spin(0.0, 1.0)],
        azimuth: BACK,
    },
    Protocol {
        name: "spins 0° and 180°, azimuth known",
        touches: &[spin(0.0, 0.5), spin(180.0, 0.5)],
        azimuth: BACK,
    },
    Protocol {
        name: "spins 0°, 90°, 180°, 270°",
        touches: &[spin(0.0, 0.5), spin(90.0, 0.5), spin(180.0, 0.5), spin(270.0, 0.5)],
        azimuth: AzimuthPrior::Unknown,
    },
    Protocol {
        name: "the same at 0.25 and 0.5 mm",
        touches: &[
            spin(0.0, 0.25),
            spin(90.0, 0.25),
            spin(180.0, 0.25),
            spin(270.0, 0.25),
            spin(0.0, 0.5),
            spin(90.0, 0.5),
            spin(180.0, 0.5),
            spin(270.0, 0.5),
        ],
        azimuth: AzimuthPrior::Unknown,
    },
];

/// Standard deviation of a shift in this comparison, Hz.
const SIGMA_HZ: f64 = 0.1;

pub(super) fn add(page: &mut Page) {
    page.heading("Several touches at an unknown angle");
    page.text(format!(
        "Standard deviations of the posterior for sample 3, with a standard deviation of \
         {SIGMA_HZ} Hz of each shift and an even prior of the angle up to 45°, whose standard \
         deviation is 13°. The depth errors are none, 0.02 mm shared by all touches of the site, \
         or 0.02 mm in each touch independently. Depths determine only one combination of \
         stiffness and angle, because a shallow contact depends on their product; turns of the \
         probe use the difference between front and back. An angle counts as identified if its \
         standard deviation is below half of the prior's.",
    ));
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let mut table = Table::new(&[
        "protocol",
        "angle",
        "depth errors",
        "stiffness, %",
        "angle, °",
        "correlation",
        "angle identified",
    ]);
    for protocol in &PROTOCOLS {
        for angle_deg in [10.0, 30.0, 45.0] {
            for (name, shared, each) in
                [("none", 0.0, 0.0), ("shared", 0.02, 0.0), ("each", 0.0, 0.02)]
            {
                let row = infer(&models, protocol, angle_deg, shared, each);
                let head = [protocol.name.to_owned(), format!("{angle_deg}°"), name.to_owned()];
                table.row(head.into_iter().chain(row));
            }
        }
    }
    page.table(table);
}

fn infer(
    models: &Models,
    protocol: &Protocol,
    angle_deg: f64,
    shared_mm: f64,
    each_mm: f64,
) -> [String; 4] {
    let touches: Vec<SiteTouch> = protocol
        .touches
        .iter()
        .map(|&Spin { spin_deg, indentation_mm }| {
            let depth = Control::Indentation.depth(indentation_mm);
            let spin_rad = spin_deg.to_radians();
            let pose = Pose::new(angle_deg.to_radians(), std::f64::consts::PI - spin_rad)
                .expect("the protocols' angles are below a right angle");
            let contact = Contact::new(pose, depth);
            let shift_hz = models
                .predict(Tier::E1, &tissue(SAMPLES_MPA[2]), &contact)
                .expect("the protocols' depths are within the contact law")
                .shift_hz;
            SiteTouch { shift_hz, sigmas: ShiftSigmas::of_resonance(SIGMA_HZ), spin_rad, depth }
        })
        .collect();
    let touch_model = TouchModel {
        tier: Tier::E1,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        kind: TissueKind::SOFT,
        shared_depth_sigma_mm: shared_mm,
        depth_sigma_mm: each_mm,
    };
    let prior = AnglePrior::Within { max_rad: FRAC_PI_4 };
    match infer_tilt(models, &touches, &touch_model, prior, protocol.azimuth) {
        Err(refusal) => [refusal.to_string(), String::new(), String::new(), String::new()],
        Ok(found) => [
            format!("{:.2}", 100.0 * found.young_mpa.sigma / found.young_mpa.value),
            format!("{:.2}", found.angle_rad.sigma.to_degrees()),
            format!("{:+.2}", found.correlation),
            if found.is_angle_identified { "yes" } else { "no" }.to_owned(),
        ],
    }
}
