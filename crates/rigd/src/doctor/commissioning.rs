//! Whether the bench may move: its commissioning, and the transcripts of its instrument files.

use rig_commission::Standing;
use rig_model::with_causes;

use super::{Finding, Findings};
use crate::{calibrations::CalibrationsError, transcripts::Unproven};

/// What is shown of a bench.
pub(crate) fn findings(
    standing: &Result<Standing, CalibrationsError>,
    unproven: &[Unproven],
) -> Vec<Finding> {
    let mut findings = Findings::of("bench");
    match standing {
        Ok(standing) if standing.is_complete() => {
            findings.ok("commissioning", "every step has a record that holds");
        }
        Ok(standing) => findings.warning(
            "commissioning",
            format!("missing: {standing}"),
            "the rig moves after it: `rigd commission` asks for one step after the other",
        ),
        Err(error) => findings.problem(
            "commissioning",
            with_causes(error),
            "the rig moves after its records can be read: mend or remove the file",
        ),
    }
    for Unproven { device, instrument, roles, trouble } in unproven {
        let roles: Vec<_> = roles.iter().map(|role| role.name()).collect();
        let trouble = trouble.as_ref().map_or(String::new(), |trouble| format!(" ({trouble})"));
        findings.warning(
            "instrument file",
            format!("{instrument} ({device}) is unproven: {}{trouble}", roles.join(", ")),
            "`rigd instrument record` records its transcript",
        );
    }
    findings.all
}

#[cfg(test)]
mod tests {
    use rig_commission::Basis;
    use rig_files::rig_file::RigFile;

    use super::*;
    use crate::{doctor::Level, transcripts::Role};

    #[test]
    fn a_bench_that_may_not_move_is_a_warning_with_what_is_missing() {
        let text = include_str!("../../../../config/rigs/simulated.toml");
        let basis = Basis::of(&RigFile::read("rig.toml", text).unwrap(), [None, None]);
        let unproven = Unproven {
            device: "analyzer",
            instrument: "meter".to_owned(),
            roles: vec![Role::Reading],
            trouble: None,
        };
        let found = findings(&Ok(Standing::of(&[], &basis, 0)), &[unproven]);
        let told: Vec<_> = found.iter().map(|one| (one.level, one.text.as_str())).collect();
        let missing = "missing: stop (never made), signs (never made), geometry (never made), scale (never made), \
                       limits (never made), homing (never made)";
        let instrument = "meter (analyzer) is unproven: reading";
        assert_eq!(told, [(Level::Warning, missing), (Level::Warning, instrument)]);
    }
}
