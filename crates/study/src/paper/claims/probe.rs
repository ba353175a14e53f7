//! Claims on the probe: the shape of its contact, its postures and how it stands.

use rig_contact::{ContactLaw, Models, Sensor, Tier};

use super::{Assessment, Claim, claim};
use crate::{
    paper::figures::{mean_hz, noiseless},
    paper_bench::{Control, SAMPLES_MPA},
};

pub(super) fn claims() -> Vec<Claim> {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let simulation = noiseless(&models, Tier::Reference, Control::Indentation);
    vec![
        claim(
            "section 2.2.2",
            "R ≥ Δ keeps the contact approximately circular",
            Assessment::HoldsInPart,
            {
                // The edge of the contact lies at asin(a/R) from the normal.
                let edge_deg = |angle: f64| {
                    let depth_rel = angle.to_radians().cos();
                    let patch = ContactLaw::Sneddon.at(depth_rel).expect("within the law");
                    angle + patch.radius_rel.asin().to_degrees()
                };
                // A contact whose edge is at the equator at 45°: a = R sin 45°, by Sneddon.
                let a = 0.5_f64.sqrt();
                format!(
                    "the contact of a ball is circular for every R, at every angle, as long as only \
                     the ball touches; a tip that ends in half a ball touches with it alone while \
                     the edge of the contact is less than 90° from its axis. At R = Δ the edge is at \
                     {:.0}° upright and at {:.0}° at 45°: just beyond. For 45° it takes R ≥ {:.2} Δ, \
                     upright R ≥ 0.5 Δ suffices for equation (4)",
                    edge_deg(0.0),
                    edge_deg(45.0),
                    a / (a * a.atanh())
                )
            },
        ),
        claim(
            "conclusions",
            "the stiffness is detected in any posture",
            Assessment::DoesNotHold,
            {
                let mean = |angle| mean_hz(&simulation, SAMPLES_MPA[3], angle);
                let fall = |angle| 100.0 * (1.0 - mean(angle) / mean(0.0));
                format!(
                    "shown for a vertical sensor, three directions and angles up to 45°. Beyond, the \
                     shift of sample 4 falls by {:.0} % at 60° and by {:.0} % at 75°, where it is that \
                     of a sample with {:.0} % and {:.0} % of its upright shift; at 90° there is no \
                     contact. A sensor turned over also has its weight on the other side, which was \
                     not tried",
                    fall(60.0),
                    fall(75.0),
                    100.0 - fall(60.0),
                    100.0 - fall(75.0)
                )
            },
        ),
        claim("Figure 1", "the probe stands across the bimorph", Assessment::Undecided, {
            // With a probe along the bimorph only the contact's stiffness along the surface bends
            // the beam upright; a tilt mixes the normal one in.
            let radius = |depth| ContactLaw::Sneddon.at(depth).expect("within the law").radius_rel;
            let (tau, cos) = (2.0 / 3.0, 0.5_f64.sqrt());
            let contact = radius(cos) / radius(1.0);
            let leaning = contact * (0.5 + tau * 0.5) / tau;
            format!(
                "the text does not say how the probe is mounted, and names front and back apart. \
                     A probe along the bimorph would feel the sideways stiffness of the sample, τ of \
                     the normal one: to 45° the stiffness that bends the beam would rise by {:.0} % to \
                     front and back and fall by {:.0} % to the left, while the paper's shifts fall in \
                     every direction. With a probe across the bimorph they fall to 45° in all of them",
                100.0 * (leaning - 1.0),
                100.0 * (1.0 - contact)
            )
        }),
    ]
}
