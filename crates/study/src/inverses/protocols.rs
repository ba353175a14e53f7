//! Several touches of one place at an unknown angle: which protocol tells what.

use std::f64::consts::FRAC_PI_4;

use rig_contact::{
    Contact, ContactLaw, Friction, Models, Pose, Sensor, Tier,
    inverse::{AnglePrior, AzimuthPrior, SiteTouch, TissueKind, TouchModel, infer_tilt},
};

use crate::{
    page::{Page, Table},
    paper_bench::{Control, SAMPLES_MPA, tissue},
};

/// Touches of a protocol: spin of the probe in degrees and indentation in mm.
struct Protocol {
    name: &'static str,
    touches: &'static [(f64, f64)],
    azimuth: AzimuthPrior,
}

/// A surface that leans to the back at zero spin.
const BACK: AzimuthPrior = AzimuthPrior::Known(std::f64::consts::PI);

const PROTOCOLS: [Protocol; 6] = [
    Protocol { name: "one touch, azimuth known", touches: &[(0.0, 0.5)], azimuth: BACK },
    Protocol {
        name: "depths 0.25 and 0.5 mm, azimuth known",
        touches: &[(0.0, 0.25), (0.0, 0.5)],
        azimuth: BACK,
    },
    Protocol {
        name: "depths 0.25 and 1 mm, azimuth known",
        touches: &[(0.0, 0.25), (0.0, 1.0)],
        azimuth: BACK,
    },
    Protocol {
        name: "spins 0° and 180°, azimuth known",
        touches: &[(0.0, 0.5), (180.0, 0.5)],
        azimuth: BACK,
    },
    Protocol {
        name: "spins 0°, 90°, 180°, 270°",
        touches: &[(0.0, 0.5), (90.0, 0.5), (180.0, 0.5), (270.0, 0.5)],
        azimuth: AzimuthPrior::Unknown,
    },
    Protocol {
        name: "the same at 0.25 and 0.5 mm",
        touches: &[
            (0.0, 0.25),
            (90.0, 0.25),
            (180.0, 0.25),
            (270.0, 0.25),
            (0.0, 0.5),
            (90.0, 0.5),
            (180.0, 0.5),
            (270.0, 0.5),
        ],
        azimuth: AzimuthPrior::Unknown,
    },
];

/// Standard deviation of a shift in this comparison, Hz.
const SIGMA_HZ: f64 = 0.1;

pub(super) fn add(page: &mut Page) {
    page.heading("Several touches at an unknown angle");
    page.text(format!(
        "Standard deviations of the posterior for sample 3, shifts known to {SIGMA_HZ} Hz, any angle \
         up to 45° equally likely beforehand (its standard deviation is then 13°). Depth errors are \
         either none, 0.02 mm shared by all touches of the place, or 0.02 mm in each by itself. \
         Depths know one combination of stiffness and angle only, because a shallow contact depends \
         on their product alone; turning the probe uses that front and back differ. An angle whose \
         standard deviation is more than half of what it was beforehand is marked: the touches do \
         not tell it.",
    ));
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let mut table = Table::new(&[
        "protocol",
        "angle",
        "depth errors",
        "stiffness, %",
        "angle, °",
        "correlation",
        "angle told",
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
        .map(|&(spin_deg, along_probe_mm)| {
            let depth = Control::Indentation.depth(along_probe_mm);
            let spin_rad = spin_deg.to_radians();
            let pose = Pose::new(angle_deg.to_radians(), std::f64::consts::PI - spin_rad)
                .expect("the protocols' angles are below a right angle");
            let contact = Contact::new(pose, depth);
            let shift_hz = models
                .predict(Tier::E1, &tissue(SAMPLES_MPA[2]), &contact)
                .expect("the protocols' depths are within the contact law")
                .shift_hz;
            SiteTouch { shift_hz, sigma_hz: SIGMA_HZ, spin_rad, depth }
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
