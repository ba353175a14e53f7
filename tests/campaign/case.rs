//! The scene and the protocol of one seed.

use rig_tests::{changed, text};

use crate::bench::Draw;

/// A scene and a protocol, as changes of the shipped ones.
#[derive(Debug)]
pub(crate) struct Case {
    pub(crate) scene: Vec<(&'static str, String)>,
    pub(crate) protocol: String,
}

impl Case {
    /// The case of this seed.
    pub(crate) fn draw(seed: u64, protocol: &str, is_varied: bool) -> Self {
        let mut scene = vec![("seed = 2020", format!("seed = {seed}"))];
        let mut protocol = text(protocol);
        if is_varied {
            let mut draw = Draw::new(seed, 0xca3e);
            scene.extend(draw.bench());
            protocol = draw.windows(&protocol);
        }
        Self { scene, protocol }
    }
}

impl Draw {
    /// Evenly on a logarithmic scale.
    fn log_between(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// The bench: from half to five times the shipped noise; a quality in air from 15 to 150; a third
    /// to twice the coupling of the shipped sensor squared; a probe that is not quite the one in the
    /// rig file; a warm room.
    fn bench(&mut self) -> Vec<(&'static str, String)> {
        vec![
            (
                "impedance_rel = 0.005",
                format!("impedance_rel = {}", self.log_between(0.0025, 0.025)),
            ),
            ("beam_loss = 0.015", format!("beam_loss = {}", self.log_between(0.0066, 0.066))),
            (
                "coupling_c_per_m2 = 10.4",
                format!("coupling_c_per_m2 = {}", self.between(6.0, 14.0)),
            ),
            ("nf_per_m = 13.3", format!("nf_per_m = {}", self.between(9.0, 18.0))),
            ("dielectric_loss = 0.018", format!("dielectric_loss = {}", self.between(0.002, 0.04))),
            ("radius_mm = 0.51 #", format!("radius_mm = {} #", self.between(0.4, 0.6))),
            ("warm_up_hz = 0.3", format!("warm_up_hz = {}", self.between(-1.0, 1.0))),
            ("per_sqrt_hour = 0.1", format!("per_sqrt_hour = {}", self.log_between(0.01, 1.0))),
            ("stiffness_rel = 0.03", format!("stiffness_rel = {}", self.between(0.0, 0.1))),
        ]
    }

    /// The windows of the sweeps, which may exclude a resonance, and their targets.
    fn windows(&mut self, protocol: &str) -> String {
        let targets = ["0.02", "0.05", "0.1"].map(|target| {
            let from = format!("\ntarget_sigma_hz = {target}\n");
            let factor = self.log_between(0.5, 3.0);
            let to = target.parse().map_or(0.1, |hz: f64| hz * factor);
            (from, format!("\ntarget_sigma_hz = {to:.4}\n"))
        });
        let windows = [
            ("min_hz = 125\n", "min_hz", self.between(100.0, 138.0)),
            ("max_hz = 160\n", "max_hz", self.between(143.0, 200.0)),
            ("min_hz = 130\n", "min_hz", self.between(110.0, 139.0)),
            ("max_hz = 260\n", "max_hz", self.log_between(155.0, 400.0)),
        ]
        .map(|(from, key, hz)| (from.to_owned(), format!("{key} = {hz:.1}\n")));
        // With an aim, the file states no target.
        let aim = (
            "stiffness_percent = 2.9\n".to_owned(),
            format!("stiffness_percent = {:.2}\n", self.log_between(2.6, 12.0)),
        );
        let changes: Vec<(&str, &str)> = targets
            .iter()
            .chain(&windows)
            .chain([&aim])
            .map(|(from, to)| (from.as_str(), to.as_str()))
            .filter(|(from, _)| protocol.contains(from))
            .collect();
        changed(protocol, &changes)
    }
}
