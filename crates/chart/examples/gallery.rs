//! Writes one chart of each kind into a directory: `cargo run -p rig-chart --example gallery DIR`.

use std::{env, error::Error, fs, path::Path};

use rig_chart::{
    Axis, Band, BandEdge, Category, Chart, HeatMap, Marker, Point, Rule, Series, Stroke, Tone,
};

fn main() -> Result<(), Box<dyn Error>> {
    let directory = env::args().nth(1).ok_or("name a directory to write into")?;
    let directory = Path::new(&directory);
    fs::create_dir_all(directory)?;
    fs::write(directory.join("shift.svg"), shift().file()?)?;
    fs::write(directory.join("cost.svg"), cost().file()?)?;
    fs::write(directory.join("classes.svg"), classes().file()?)?;
    fs::write(directory.join("failures.svg"), failures().file()?)?;
    Ok(())
}

/// Lines with error bars.
fn shift() -> Chart {
    let mut chart = Chart::new(
        "Frequency shift against contact angle",
        "The shift falls with the angle, the more the stiffer the sample.",
        Axis::linear("contact angle (°)").with_ticks(&[0.0, 15.0, 30.0, 45.0]),
        Axis::linear("frequency shift Δf (Hz)").including(0.0),
    );
    let samples = [
        ("sample 1, 0.045 MPa", 8.0),
        ("sample 2, 0.104 MPa", 17.8),
        ("sample 3, 0.235 MPa", 37.7),
        ("sample 4, 0.320 MPa", 49.4),
        ("sample 5, 0.649 MPa", 89.0),
    ];
    for (index, (name, level)) in samples.into_iter().enumerate() {
        let points = [0.0, 15.0, 30.0, 45.0].map(|angle: f64| Point {
            x: angle,
            y: level * (1.0 - 0.22 * angle.to_radians().sin().powi(2) * 2.0),
            error: Some(0.3 + 0.05 * level),
            note: Some(format!("{name} at {angle}°")),
        });
        chart.series.push(Series::joined(name, index, points));
    }
    chart
}

/// Logarithmic axes, a band, rules, a dashed line.
fn cost() -> Chart {
    let mut chart = Chart::new(
        "Cost against error",
        "Error falls with the square root of the time spent.",
        Axis::log("time of measuring (s)"),
        Axis::log("error (Hz)"),
    );
    let times = (0..40).map(|index| 10.0_f64.powf(f64::from(index) / 13.0 - 1.5));
    let curve = |factor: f64| move |time: f64| (time, factor * 0.03 / time.sqrt());
    let edge = |x: f64| BandEdge { x, low: 0.02 / x.sqrt(), high: 0.05 / x.sqrt() };
    chart.bands.push(Band {
        name: Some("95 % of runs".to_owned()),
        edges: times.clone().map(edge).collect(),
        colour: 0,
    });
    chart.series.push(Series::line("planner", 0, times.clone().map(curve(1.0))));
    chart.series.push(Series {
        stroke: Some(Stroke::Dashed),
        ..Series::line("Cramér–Rao bound", 6, times.step_by(3).map(curve(0.6)))
    });
    chart.series.push(Series::scatter("uniform sweep", 1, [(2.0, 0.2), (9.0, 0.11), (30.0, 0.05)]));
    chart.rules.push(Rule::AtY { value: 0.03, label: "what the scene allows".to_owned() });
    chart.rules.push(Rule::AtX { value: 0.2, label: "settling".to_owned() });
    chart
}

/// Points by class, some of them ringed.
fn classes() -> Chart {
    let mut chart = Chart::new(
        "Blind touches by cluster",
        "Twenty touches in five clusters; two are in the wrong one.",
        Axis::linear("trial"),
        Axis::linear("frequency shift Δf (Hz)").including(0.0),
    );
    for cluster in 0..5_u32 {
        let touches = (0..4_u32).map(|touch| {
            let trial = f64::from(touch * 5 + cluster + 1);
            (trial, f64::from(cluster * 18 + 9) + 1.7 * (trial * 2.3).sin())
        });
        let name = format!("cluster {}", cluster + 1);
        chart.series.push(Series::scatter(&name, cluster as usize, touches));
    }
    let wrong = [(9.0, 63.0 + 1.7 * 20.7_f64.sin()), (17.0, 27.0 + 1.7 * 39.1_f64.sin())];
    let rings = Series::scatter("in the wrong cluster", 6, wrong);
    chart.series.push(Series { marker: Some(Marker::Ring), ..rings });
    chart
}

/// A categorical heat map.
fn failures() -> HeatMap {
    let category = |name: &str, tone, symbol: &str| Category {
        name: name.to_owned(),
        tone,
        symbol: symbol.to_owned(),
    };
    HeatMap {
        title: "Where the estimator fails".to_owned(),
        description: "Right at low noise and high quality, flagged elsewhere.".to_owned(),
        x_label: "figure of merit".to_owned(),
        y_label: "noise (%)".to_owned(),
        columns: ["0.1", "0.2", "0.5", "1", "2", "5", "10", "20"].map(String::from).to_vec(),
        rows: ["0.1", "0.2", "0.5", "1", "2", "5"].map(String::from).to_vec(),
        categories: vec![
            category("right", Tone::Good, ""),
            category("flagged", Tone::Fair, "!"),
            category("silently wrong", Tone::Bad, "×"),
            category("not run", Tone::None, "–"),
        ],
        cells: (0..48)
            .map(|cell: usize| match (cell / 8, cell % 8) {
                (5, 7) => 3,
                (row, column) if row > column + 3 => 2,
                (row, column) => usize::from(row + 1 > column),
            })
            .collect(),
    }
}
