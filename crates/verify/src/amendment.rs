//! What an amendment says of the run that it is of.

use crate::{
    finding::{Check, Findings},
    journal::Head,
    record::{Amended, Touch},
};

/// What is done with a touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Amendment {
    /// It is measured again.
    Redo,
    /// It is left out.
    Skip,
}

/// The run that an amendment is of.
#[derive(Debug)]
pub(crate) struct Amends {
    /// Its id, which is the name of the amendment.
    pub(crate) run: String,
    pub(crate) touches: Vec<Touch>,
    pub(crate) head: Option<Head>,
}

impl Amends {
    /// The planned touch with this address.
    pub(crate) fn touch(&self, step: &str) -> Option<&Touch> {
        self.touches.iter().find(|touch| touch.step == step)
    }
}

/// Checks the first record of an amendment.
pub(crate) fn check(seq: u64, amended: &Amended, amends: Option<&Amends>, findings: &mut Findings) {
    let Amended { run, head, who, step, what, why, .. } = amended;
    let mut add = |check, of: &str, expected: &str, found: &str| {
        findings.add(check, seq, format!("{of} of the amendment of {step}"), expected, found);
    };
    if !["redo", "skip"].contains(&&**what) {
        add(Check::Ends, "the kind", "redo or skip", what);
    }
    for (of, text) in [("the reason", why), ("the person", who)] {
        if text.trim().is_empty() {
            add(Check::Ends, of, "a word", &format!("{text:?}"));
        }
    }
    let Some(amends) = amends else { return };
    if *run != amends.run {
        add(Check::Ends, "the run", &amends.run, run);
    }
    if amends.touch(step).is_none() {
        add(Check::Row, "the touch", "a touch of the run", "none");
    }
    let Some(Head { last, has_ended, is_of_run }) = &amends.head else { return };
    // In a run under way a touch is left out between two of its records.
    let may_be_before = what == "skip" && !has_ended && *is_of_run;
    if head != last && !may_be_before {
        add(Check::Digest, "the last record of the run", last, head);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Pose;

    fn amends(has_ended: bool) -> Amends {
        let pose = Pose { direction: "front".to_owned(), angle_deg: 0.0 };
        let step = "main/1/front/0/1".to_owned();
        let (phase, sample) = ("main".to_owned(), "1".to_owned());
        Amends {
            run: "run".to_owned(),
            touches: vec![Touch { step, phase, sample, pose, repeat: 1 }],
            head: Some(Head { last: "ab".to_owned(), has_ended, is_of_run: true }),
        }
    }

    #[test]
    fn an_amendment_is_of_a_touch_and_of_the_end_of_its_run() {
        let sound = ["run", "ab", "a person", "main/1/front/0/1", "redo", "a hair"];
        let rows: [(&str, [&str; 6], bool, usize); 9] = [
            ("sound", sound, true, 0),
            ("another run", ["other", "ab", "a person", sound[3], "redo", "a hair"], true, 1),
            ("another head", ["run", "cd", "a person", sound[3], "redo", "a hair"], true, 1),
            ("a head of a redo", ["run", "cd", "a person", sound[3], "redo", "a hair"], false, 1),
            ("a head under way", ["run", "cd", "a person", sound[3], "skip", "a hair"], false, 0),
            ("no person", ["run", "ab", " ", sound[3], "redo", "a hair"], true, 1),
            ("another touch", ["run", "ab", "a person", "main/2", "redo", "a hair"], true, 1),
            ("another kind", ["run", "ab", "a person", sound[3], "keep", "a hair"], true, 1),
            ("no reason", ["run", "ab", "a person", sound[3], "skip", " \t"], true, 1),
        ];
        for (name, values, has_ended, expected) in rows {
            let [run, head, who, step, what, why] = values.map(str::to_owned);
            let amended = Amended {
                run,
                head,
                who,
                step,
                what,
                why,
                software: None,
                rig: None,
                calibrations: None,
                devices: Vec::new(),
                changes: Vec::new(),
            };
            let mut findings = Findings::default();
            check(1, &amended, Some(&amends(has_ended)), &mut findings);
            assert_eq!(findings.0.len(), expected, "{name}: {findings:?}");
        }
    }
}
