//! `rig-study invert`: the stiffness for a measured shift.

use std::{f64::consts::PI, io::Write, str::FromStr};

use rig_contact::{
    Models, Tier,
    inverse::{
        AnglePrior, AzimuthPrior, Interval, LogVariances, ShiftSigmas, SiteTouch, TiltInference,
        TouchModel, TouchSigmas, infer_tilt,
    },
};
use serde::Serialize;

use crate::{
    contact_args::{ContactArgs, ContactNames, SensorArgs, not_negative, tier_parser},
    outcome::{StudyError, print_json},
};

/// The stiffness of one touch at a known angle, or of several touches at an unknown angle.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["shift_hz", "touch"])))]
pub(crate) struct Args {
    /// Model of the vibration.
    #[arg(value_parser = tier_parser(), ignore_case = true)]
    tier: Tier,
    /// Shift of one touch at the given angle and direction, Hz.
    #[arg(long)]
    shift_hz: Option<f64>,
    /// A touch of a site at an unknown angle: spin of the probe in degrees, indentation in mm and
    /// shift in Hz. Several touches are needed.
    #[arg(long, value_name = "SPIN,DEPTH,SHIFT", conflicts_with_all = ["angle_deg", "direction"])]
    touch: Vec<TouchArg>,
    /// Standard deviation of a shift, Hz.
    #[arg(long, default_value_t = 0.3, value_parser = not_negative)]
    shift_sigma_hz: f64,
    /// Standard deviation of the depth, mm; for several touches that of the shared error.
    #[arg(long, default_value_t = 0.02, value_parser = not_negative)]
    depth_sigma_mm: f64,
    /// Standard deviation of the independent depth error of each of several touches, mm.
    #[arg(long, default_value_t = 0.0, requires = "touch", value_parser = not_negative)]
    each_depth_sigma_mm: f64,
    /// Standard deviation of the angle, degrees.
    #[arg(long, default_value_t = 1.0, value_parser = not_negative)]
    angle_sigma_deg: f64,
    /// Largest possible angle of several touches, degrees.
    #[arg(long, default_value_t = 45.0, requires = "touch")]
    angle_max_deg: f64,
    /// Azimuth of the normal at zero spin, degrees from the front towards the left. Default:
    /// unknown.
    #[arg(long, requires = "touch")]
    azimuth_deg: Option<f64>,
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    sensor: SensorArgs,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Spin in degrees, indentation in mm, shift in Hz.
#[derive(Debug, Clone, Copy)]
struct TouchArg([f64; 3]);

/// A malformed touch.
#[derive(Debug, thiserror::Error)]
#[error("a touch is SPIN,DEPTH,SHIFT in degrees, mm and Hz")]
struct TouchArgError;

impl FromStr for TouchArg {
    type Err = TouchArgError;

    fn from_str(text: &str) -> Result<Self, TouchArgError> {
        let numbers: Vec<f64> = text
            .split(',')
            .map(|part| part.trim().parse())
            .collect::<Result<_, _>>()
            .map_err(|_| TouchArgError)?;
        <[f64; 3]>::try_from(numbers).map(Self).map_err(|_| TouchArgError)
    }
}

#[derive(Debug, Serialize)]
struct OneAnswer {
    status: &'static str,
    tier: &'static str,
    shift_hz: f64,
    #[serde(flatten)]
    contact: ContactNames,
    stiffness_mpa: f64,
    sigma_mpa: f64,
    sigma_of_shift_mpa: f64,
    sigma_of_depth_mpa: f64,
    sigma_of_angle_mpa: f64,
}

#[derive(Debug, Serialize)]
struct SiteAnswer {
    status: &'static str,
    tier: &'static str,
    stiffness_mpa: IntervalAnswer,
    sigma_of_shift_mpa: f64,
    sigma_of_depth_mpa: f64,
    /// Of angle and azimuth, as far as the touches leave them unknown.
    sigma_of_angle_mpa: f64,
    angle_deg: IntervalAnswer,
    azimuth_deg: IntervalAnswer,
    is_angle_identified: bool,
    is_azimuth_identified: bool,
    correlation_of_stiffness_and_angle: f64,
    chi_squared: f64,
    freedom: usize,
}

#[derive(Debug, Clone, Copy, Serialize)]
struct IntervalAnswer {
    value: f64,
    sigma: f64,
    low_95: f64,
    high_95: f64,
}

impl IntervalAnswer {
    fn scaled(interval: Interval, factor: f64) -> Self {
        let Interval { value, sigma, low, high } = interval;
        Self {
            value: value * factor,
            sigma: sigma * factor,
            low_95: low * factor,
            high_95: high * factor,
        }
    }
}

impl SiteAnswer {
    fn of(tier: Tier, found: &TiltInference) -> Self {
        let LogVariances { resonance, reference, sample, own_depth, shared_depth, tilt } =
            found.log_variances;
        let sigma_mpa = |variance: f64| found.young_mpa.value * variance.sqrt();
        Self {
            status: "ok",
            tier: tier.name(),
            stiffness_mpa: IntervalAnswer::scaled(found.young_mpa, 1.0),
            sigma_of_shift_mpa: sigma_mpa(resonance + reference + sample),
            sigma_of_depth_mpa: sigma_mpa(own_depth + shared_depth),
            sigma_of_angle_mpa: sigma_mpa(tilt),
            angle_deg: IntervalAnswer::scaled(found.angle_rad, 180.0 / PI),
            azimuth_deg: IntervalAnswer::scaled(found.azimuth_rad, 180.0 / PI),
            is_angle_identified: found.is_angle_identified,
            is_azimuth_identified: found.is_azimuth_identified,
            correlation_of_stiffness_and_angle: found.correlation,
            chi_squared: found.chi_squared,
            freedom: found.freedom,
        }
    }
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let sensor = args.sensor.sensor()?;
    let models = Models::new(&sensor, args.contact.law(args.tier));
    match args.shift_hz {
        Some(shift_hz) => one(args, &models, shift_hz, out),
        None => site(args, &models, out),
    }
}

fn one(
    args: &Args,
    models: &Models,
    shift_hz: f64,
    out: &mut impl Write,
) -> Result<(), StudyError> {
    let contact = args.contact.contact(args.tier)?;
    let sigmas = TouchSigmas {
        shift_hz: args.shift_sigma_hz,
        depth_mm: args.depth_sigma_mm,
        angle_rad: args.angle_sigma_deg.to_radians(),
    };
    let found = models
        .stiffness_of_touch(args.tier, shift_hz, sigmas, args.contact.kind(), &contact)
        .map_err(StudyError::refused);
    let answer = found.map(|found| OneAnswer {
        status: "ok",
        tier: args.tier.name(),
        shift_hz,
        contact: args.contact.names(args.tier),
        stiffness_mpa: found.young_mpa,
        sigma_mpa: found.sigma_mpa,
        sigma_of_shift_mpa: found.sigma_of_shift_mpa,
        sigma_of_depth_mpa: found.sigma_of_depth_mpa,
        sigma_of_angle_mpa: found.sigma_of_angle_mpa,
    });
    if args.json {
        return print_json(answer, out);
    }
    let answer = answer?;
    let (value, sigma) = (answer.stiffness_mpa, answer.sigma_mpa);
    writeln!(out, "stiffness {value:.6} MPa, standard deviation {sigma:.6} MPa")?;
    let parts = [answer.sigma_of_shift_mpa, answer.sigma_of_depth_mpa, answer.sigma_of_angle_mpa];
    write_parts(parts, out)
}

/// The parts of a standard deviation due to shift, depth and angle, MPa.
fn write_parts([shift, depth, angle]: [f64; 3], out: &mut impl Write) -> Result<(), StudyError> {
    writeln!(
        out,
        "of which {shift:.6} due to the shift, {depth:.6} due to the depth, {angle:.6} due to the angle"
    )?;
    Ok(())
}

fn site(args: &Args, models: &Models, out: &mut impl Write) -> Result<(), StudyError> {
    let touches: Vec<SiteTouch> = args
        .touch
        .iter()
        .map(|&TouchArg([spin_deg, depth_mm, shift_hz])| SiteTouch {
            shift_hz,
            sigmas: ShiftSigmas::of_resonance(args.shift_sigma_hz),
            spin_rad: spin_deg.to_radians(),
            depth: args.contact.depth(depth_mm),
        })
        .collect();
    let touch_model = TouchModel {
        tier: args.tier,
        law: args.contact.law(args.tier),
        friction: args.contact.friction(),
        kind: args.contact.kind(),
        shared_depth_sigma_mm: args.depth_sigma_mm,
        depth_sigma_mm: args.each_depth_sigma_mm,
    };
    let angle = AnglePrior::Within { max_rad: args.angle_max_deg.to_radians() };
    let azimuth = args
        .azimuth_deg
        .map_or(AzimuthPrior::Unknown, |degrees| AzimuthPrior::Known(degrees.to_radians()));
    let found =
        infer_tilt(models, &touches, &touch_model, angle, azimuth).map_err(StudyError::refused);
    let answer = found.map(|found| SiteAnswer::of(args.tier, &found));
    if args.json {
        return print_json(answer, out);
    }
    let answer = answer?;
    // A given azimuth is not a result.
    let azimuth = args.azimuth_deg.is_none().then_some((
        "azimuth",
        answer.azimuth_deg,
        "°",
        answer.is_azimuth_identified,
    ));
    for (what, IntervalAnswer { value, sigma, low_95, high_95 }, unit, is_known) in [
        ("stiffness", answer.stiffness_mpa, "MPa", true),
        ("angle", answer.angle_deg, "°", answer.is_angle_identified),
    ]
    .into_iter()
    .chain(azimuth)
    {
        let doubt = if is_known { "" } else { ": not identified by these touches" };
        writeln!(
            out,
            "{what} {value:.5} {unit}, standard deviation {sigma:.5} {unit}, 95 % in \
             [{low_95:.5}, {high_95:.5}] {unit}{doubt}"
        )?;
    }
    let parts = [answer.sigma_of_shift_mpa, answer.sigma_of_depth_mpa, answer.sigma_of_angle_mpa];
    write_parts(parts, out)?;
    let correlation = answer.correlation_of_stiffness_and_angle;
    writeln!(out, "correlation of stiffness and angle {correlation:+.2}")?;
    let (chi, freedom) = (answer.chi_squared, answer.freedom);
    writeln!(out, "chi-squared {chi:.2} with {freedom} degrees of freedom")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    fn run_json(line: &str) -> (Result<(), StudyError>, serde_json::Value) {
        let words = ["invert"].into_iter().chain(line.split(' ')).chain(["--json"]);
        let args = Cli::try_parse_from(words).unwrap().args;
        let mut out = Vec::new();
        let result = run(&args, &mut out);
        (result, serde_json::from_slice(&out).unwrap())
    }

    #[test]
    fn the_printed_sensitivity_comes_back() {
        let (result, answer) = run_json("T0 --shift-hz 13.411");
        assert!(result.is_ok());
        let found = answer["stiffness_mpa"].as_f64().unwrap();
        assert!((found - 0.1).abs() < 1e-12, "{found}");
        assert!(answer["sigma_mpa"].as_f64().unwrap() > 0.002);
    }

    /// Shifts of a sample of 0.235 MPa leaning 30° to the front, from the reference tier.
    #[test]
    fn four_spins_give_back_stiffness_and_angle() {
        let (result, answer) = run_json(
            "E1 --shift-sigma-hz 0.1 --touch 0,0.5,36.37 --touch 90,0.5,33.51 \
             --touch 180,0.5,31.19 --touch 270,0.5,33.51",
        );
        assert!(result.is_ok(), "{answer}");
        assert!(
            (answer["stiffness_mpa"]["value"].as_f64().unwrap() - 0.235).abs() < 0.003,
            "{answer}"
        );
        assert!((answer["angle_deg"]["value"].as_f64().unwrap() - 30.0).abs() < 1.5, "{answer}");
        assert_eq!(answer["is_angle_identified"], true);
        let parts = ["shift", "depth", "angle"]
            .map(|part| answer[format!("sigma_of_{part}_mpa")].as_f64().unwrap());
        assert!(parts.iter().all(|part| *part > 0.0), "{answer}");
        let sigma = answer["stiffness_mpa"]["sigma"].as_f64().unwrap();
        let together = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
        assert!((together / sigma - 1.0).abs() < 1e-9, "{answer}");
    }

    #[test]
    fn a_shift_without_contact_is_refused_with_its_reason() {
        let (result, answer) = run_json("E1 --shift-hz -1");
        assert!(matches!(result, Err(StudyError::Refused(_))));
        assert_eq!(answer["reason"], "a shift of -1 Hz shows no contact");
        assert!(Cli::try_parse_from(["invert", "E1"]).is_err());
        assert!(Cli::try_parse_from(["invert", "E1", "--touch", "1,2"]).is_err());
    }
}
