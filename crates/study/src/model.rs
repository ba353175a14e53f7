//! `rig-study model`: one contact by one tier.

use std::io::Write;

use rig_contact::{Contact, Models, Tier, Tissue};
use serde::Serialize;

use crate::{
    contact_args::{ContactArgs, ContactNames, SensorArgs, tier_parser},
    outcome::{StudyError, print_json},
};

/// Contact radius, stiffness, shift and validity of one contact by one tier.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub(crate) struct Args {
    /// Model of the vibration.
    #[arg(value_parser = tier_parser(), ignore_case = true)]
    tier: Tier,
    /// Young's modulus of the tissue, MPa.
    #[arg(long)]
    stiffness_mpa: f64,
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    sensor: SensorArgs,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Answer {
    status: &'static str,
    tier: &'static str,
    stiffness_mpa: f64,
    #[serde(flatten)]
    contact: ContactNames,
    normal_depth_mm: f64,
    contact_radius_mm: f64,
    force_n: f64,
    normal_stiffness_n_per_m: f64,
    tangential_stiffness_n_per_m: f64,
    no_load_hz: f64,
    shift_hz: f64,
    resonance_hz: f64,
    circuit: Option<CircuitAnswer>,
    validity: ValidityAnswer,
}

#[derive(Debug, Serialize)]
struct CircuitAnswer {
    series_resonance_hz: f64,
    q: f64,
    capacitance_f: f64,
    capacitance_ratio: f64,
    dielectric_loss: f64,
    figure_of_merit: f64,
}

#[derive(Debug, Serialize)]
struct ValidityAnswer {
    depth_rel: f64,
    depth_rel_max: f64,
    stiffness_ratio: f64,
    /// `None` for a tier without a limit.
    stiffness_ratio_max: Option<f64>,
    takes_stage_moves: bool,
    /// This shift less that of the reference; `None` where the reference refuses.
    difference_from_reference_hz: Option<f64>,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let answer = answer(args);
    if args.json {
        return print_json(answer, out);
    }
    let answer = answer?;
    let validity = &answer.validity;
    writeln!(out, "tier {} with {} contact", answer.tier, answer.contact.law())?;
    let rows = [
        ("contact radius", answer.contact_radius_mm, "mm"),
        ("depth normal to the surface", answer.normal_depth_mm, "mm"),
        ("force normal to the surface", answer.force_n, "N"),
        ("normal contact stiffness", answer.normal_stiffness_n_per_m, "N/m"),
        ("tangential contact stiffness", answer.tangential_stiffness_n_per_m, "N/m"),
        ("no-load resonance", answer.no_load_hz, "Hz"),
        ("shift", answer.shift_hz, "Hz"),
    ];
    for (what, value, unit) in rows {
        writeln!(out, "{what:<30}{value:>14.6} {unit}")?;
    }
    let limit = validity.stiffness_ratio_max.map_or("any".to_owned(), |limit| limit.to_string());
    writeln!(
        out,
        "valid: depth {:.4} of {} ball radii, contact {:.4} of {limit} sensor stiffnesses",
        validity.depth_rel, validity.depth_rel_max, validity.stiffness_ratio
    )?;
    match validity.difference_from_reference_hz {
        Some(difference_hz) => {
            writeln!(out, "difference from the reference: {difference_hz:+.3} Hz")?;
        }
        None => writeln!(out, "the reference takes no such contact")?,
    }
    Ok(())
}

fn answer(args: &Args) -> Result<Answer, StudyError> {
    let sensor = args.sensor.sensor()?;
    let contact = args.contact.contact(args.tier)?;
    let kind = args.contact.kind();
    let tissue =
        Tissue::new(args.stiffness_mpa, kind.poisson, kind.loss).map_err(StudyError::arguments)?;
    let models = Models::new(&sensor, contact.law);
    let found = models.predict(args.tier, &tissue, &contact).map_err(StudyError::refused)?;
    let load = found.load;
    let no_load_hz = models.no_load_hz(args.tier);
    let validity = args.tier.validity();
    let circuit = validity
        .has_impedance
        .then(|| models.circuit(args.tier, &tissue, &contact))
        .transpose()
        .map_err(StudyError::refused)?;
    let limit = validity.stiffness_ratio_max;
    // The paper's contact law is part of T0, and not of the reference.
    let fine = Contact { law: args.contact.law(Tier::Reference), ..contact };
    let difference_hz = models
        .predict(Tier::Reference, &tissue, &fine)
        .ok()
        .map(|reference| found.shift_hz - reference.shift_hz);
    Ok(Answer {
        status: "ok",
        tier: args.tier.name(),
        stiffness_mpa: args.stiffness_mpa,
        contact: args.contact.names(args.tier),
        normal_depth_mm: load.depth_mm,
        contact_radius_mm: load.radius_mm,
        force_n: load.force_n,
        normal_stiffness_n_per_m: load.normal_n_per_m,
        tangential_stiffness_n_per_m: load.tangential_n_per_m,
        no_load_hz,
        shift_hz: found.shift_hz,
        resonance_hz: no_load_hz + found.shift_hz,
        circuit: circuit.map(|circuit| CircuitAnswer {
            series_resonance_hz: circuit.series_resonance_hz,
            q: circuit.q,
            capacitance_f: circuit.capacitance_f,
            capacitance_ratio: circuit.capacitance_ratio,
            dielectric_loss: circuit.dielectric_loss,
            figure_of_merit: circuit.figure_of_merit(),
        }),
        validity: ValidityAnswer {
            depth_rel: load.depth_mm / sensor.design().probe_radius_mm,
            depth_rel_max: contact.law.depth_limit_rel(),
            stiffness_ratio: models.stiffness_ratio(&load),
            stiffness_ratio_max: limit.is_finite().then_some(limit),
            takes_stage_moves: validity.takes_stage_moves,
            difference_from_reference_hz: difference_hz,
        },
    })
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
        let words = ["model"].into_iter().chain(line.split(' ')).chain(["--json"]);
        let args = Cli::try_parse_from(words).unwrap().args;
        let mut out = Vec::new();
        let result = run(&args, &mut out);
        (result, serde_json::from_slice(&out).unwrap())
    }

    /// Equation (7) with the printed sensitivity, by hand.
    #[test]
    fn t0_is_the_printed_sensitivity_times_the_paper_radius() {
        let (result, answer) =
            run_json("t0 --stiffness-mpa 0.235 --angle-deg 45 --direction left --radius-mm 0.5");
        assert!(result.is_ok());
        let fall = (0.5_f64.sqrt() - 0.125).sqrt() / 0.75_f64.sqrt();
        let shift = answer["shift_hz"].as_f64().unwrap();
        assert!((shift - 134.11 * 0.235 * fall).abs() < 1e-9, "{shift}");
        assert_eq!(answer["law"], "paper");
        assert_eq!(answer["circuit"], serde_json::Value::Null);
    }

    #[test]
    fn every_tier_answers_the_papers_stiffest_sample_at_its_steepest_angle() {
        for tier in ["T0", "T0b", "T1", "T2", "T2s", "E1", "E1s", "exact", "reference"] {
            let (result, answer) = run_json(&format!(
                "{tier} --stiffness-mpa 0.649 --angle-deg 45 --direction back --indentation-mm 0.5"
            ));
            assert!(result.is_ok(), "{tier}: {result:?}");
            let shift = answer["shift_hz"].as_f64().unwrap();
            assert!((60.0..83.0).contains(&shift), "{tier}: {shift}");
            let difference = &answer["validity"]["difference_from_reference_hz"];
            assert!(difference.as_f64().unwrap().abs() < 20.0, "{tier}: {difference}");
        }
    }

    /// A tier without losses in a tissue with a loss factor of 1.
    #[test]
    fn the_difference_from_the_reference_is_that_of_the_contact_asked_for() {
        let (result, answer) = run_json("exact --stiffness-mpa 1 --loss 1");
        assert!(result.is_ok(), "{result:?}");
        let difference = &answer["validity"]["difference_from_reference_hz"];
        assert!(difference.as_f64().unwrap() < -1.3, "{difference}");
    }

    #[test]
    fn a_refusal_is_an_answer_with_its_reason() {
        let (result, answer) = run_json("E1 --stiffness-mpa 0.1 --indentation-mm 1.2");
        assert!(matches!(result, Err(StudyError::Refused(_))));
        assert_eq!(answer["status"], "refused");
        assert_eq!(
            answer["reason"],
            "sneddon contact law: depth of 2.4 ball radii is outside [0, 2]"
        );
        let (result, answer) = run_json("T2 --stiffness-mpa 0.1 --stage");
        assert!(matches!(result, Err(StudyError::Refused(_))));
        assert_eq!(answer["reason"], "tier T2: a move of the stage is not an indentation");
    }
}
