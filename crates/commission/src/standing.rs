//! Which steps of commissioning a rig has behind it.

use crate::{Basis, Calibration, Kind, Step};

/// Why a step is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    /// It was never made.
    Never,
    /// Its last record was made with other values in the rig file.
    OtherKeys,
    /// Its last record was made with other drives, with another instrument file of a drive, or on another port.
    OtherDrives,
    /// It failed.
    Failed,
    /// It found that the rig file must be changed.
    RigFile,
    /// Its record has expired.
    Expired,
    /// The bench was changed since.
    Changed,
    /// It was begun, and has not ended.
    Begun,
    /// Its record is accepted, and has a time that is later than now: its age is not known.
    Later,
}

impl Why {
    /// For a person.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Never => "never made",
            Self::OtherKeys => "made with other values in the rig file",
            Self::OtherDrives => {
                "made with other drives, another instrument file of a drive, or another port"
            }
            Self::Failed => "failed",
            Self::RigFile => "it says that the rig file must be changed",
            Self::Expired => "expired",
            Self::Changed => "the bench was changed since",
            Self::Begun => "begun, and not ended",
            Self::Later => "its record is dated later than the clock of this computer says now",
        }
    }
}

/// What calibrations show of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Standing {
    /// Each step, with its record that fits, or why there is none.
    pub steps: Vec<(Step, Result<Calibration, Why>)>,
}

impl Standing {
    /// The last record of each step decides.
    pub fn of(records: &[Calibration], basis: &Basis, unix_s: i64) -> Self {
        let found = |step| holding(Kind::from(step), records, basis, unix_s).cloned();
        Self { steps: Step::ALL.map(|step| (step, found(step))).into() }
    }

    /// The steps without a record that fits, in their order.
    pub fn missing(&self) -> impl Iterator<Item = (Step, Why)> {
        self.steps.iter().filter_map(|(step, found)| found.as_ref().err().map(|why| (*step, *why)))
    }

    /// Whether a step has a record that fits.
    pub fn has(&self, step: Step) -> bool {
        self.steps.iter().any(|(held, found)| *held == step && found.is_ok())
    }

    /// Whether the rig may move.
    pub fn is_complete(&self) -> bool {
        self.missing().next().is_none()
    }
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, (step, why)) in self.missing().enumerate() {
            let comma = if index == 0 { "" } else { ", " };
            write!(f, "{comma}{} ({})", step.name(), why.text())?;
        }
        Ok(())
    }
}

/// The record of a kind that holds: its last one, if it is accepted.
///
/// # Errors
/// [`Why`] there is none.
pub fn holding<'a>(
    kind: Kind,
    records: &'a [Calibration],
    basis: &Basis,
    unix_s: i64,
) -> Result<&'a Calibration, Why> {
    let of_kind = || records.iter().filter(|record| record.kind == kind);
    // A change of the bench holds with any values of the keys, and with any ports: they may be put back.
    let fitting = of_kind().filter(|record| {
        let is_change = record.is_void() && record.is_of_bench(basis);
        is_change || record.has_drives_of(basis) && record.has_keys_of(basis)
    });
    // Of two with the same number, the later one in the order of the names.
    let last = fitting.max_by_key(|record| record.order()).ok_or_else(|| {
        match of_kind().max_by_key(|record| record.order()) {
            None => Why::Never,
            Some(last) if last.has_drives_of(basis) => Why::OtherKeys,
            Some(_) => Why::OtherDrives,
        }
    })?;
    if last.is_expired(unix_s) {
        Err(Why::Expired)
    } else if last.is_accepted() && last.is_of_later(unix_s) {
        Err(Why::Later)
    } else if last.is_accepted() {
        Ok(last)
    } else if last.is_void() {
        Err(Why::Changed)
    } else if last.is_begun() {
        Err(Why::Begun)
    } else if last.changes.is_empty() {
        Err(Why::Failed)
    } else {
        Err(Why::RigFile)
    }
}

/// Whether the power of these drives went for a homing that has not ended. The zero of a drive may be at another place
/// since: what rests on it is to be shown again, and the next homing shows only that the new zero stays.
pub fn is_homing_begun(records: &[Calibration], basis: &Basis) -> bool {
    let of_drives =
        records.iter().filter(|record| record.kind == Kind::Homing && record.has_drives_of(basis));
    // Keys of the rig file that were changed meanwhile do not bring a zero back.
    of_drives.max_by_key(|record| record.order()).is_some_and(Calibration::is_begun)
}

/// The last record that a change of the bench has voided what was shown of a kind with these drives.
pub fn last_change<'a>(
    kind: Kind,
    records: &'a [Calibration],
    basis: &Basis,
) -> Option<&'a Calibration> {
    let is_change = |record: &&Calibration| {
        record.kind == kind && record.is_of_bench(basis) && record.is_void()
    };
    records.iter().filter(is_change).max_by_key(|record| record.order())
}

/// The last accepted record of a kind with these keys and drives, since the bench was changed; whether it has expired, or
/// was followed by one that failed, does not matter.
pub fn last_accepted<'a>(
    kind: Kind,
    records: &'a [Calibration],
    basis: &Basis,
) -> Option<&'a Calibration> {
    let is_after = |record: &&Calibration, since: Option<&Calibration>| {
        since.is_none_or(|since| since.order() < record.order())
    };
    let since = last_change(kind, records, basis);
    let of_kind = records.iter().filter(|record| record.kind == kind);
    of_kind
        .filter(|record| record.has_drives_of(basis) && record.has_keys_of(basis))
        .filter(|record| record.is_accepted() && is_after(record, since))
        .max_by_key(|record| record.order())
}

/// The daily checks since the bench was changed, the oldest first: those with the present keys and drives, and with
/// `protocols` of this digest if it is given.
pub fn checks<'a>(
    records: &'a [Calibration],
    basis: &Basis,
    protocols: Option<&str>,
) -> Vec<&'a Calibration> {
    let is_of_bench = |record: &&Calibration| {
        let is_change = record.is_void() && record.is_of_bench(basis);
        record.kind == Kind::Check && (is_change || record.has_drives_of(basis))
    };
    let mut found: Vec<_> = records.iter().filter(is_of_bench).collect();
    // The names of the files are in the order of time within a second.
    found.sort_by_key(|record| record.made_unix_s());
    let since = found.iter().filter(|record| record.is_void()).map(|record| record.order()).max();
    found.retain(|record| {
        let is_after = !record.is_void() && since.is_none_or(|since| since < record.order());
        let has_protocols = |sha256| record.has_protocols(sha256);
        is_after && record.has_keys_of(basis) && protocols.is_none_or(has_protocols)
    });
    found
}

#[cfg(test)]
mod tests {
    use rig_files::rig_file::RigFile;

    use super::*;
    use crate::{BenchChange, Circumstances, Finding};

    const YEAR_S: i64 = 365 * 86_400;

    fn basis(step_mm: &str) -> Basis {
        let text = include_str!("../../../config/rigs/simulated.toml");
        let old = "mm_per_step = 0.001";
        assert!(text.contains(old));
        let text = text.replacen(old, &format!("mm_per_step = {step_mm}"), 1);
        Basis::of(&RigFile::read("rig.toml", &text).unwrap(), [None, None])
    }

    fn around(unix_s: i64) -> Circumstances {
        Circumstances {
            sequence: 0,
            unix_s,
            made: "2026-11-25T00:00:00Z".to_owned(),
            person: "ada".to_owned(),
            software: "rigd 0".to_owned(),
            journal: Vec::new(),
            temperature_c: None,
        }
    }

    fn accepted(kind: Kind, basis: &Basis, unix_s: i64) -> Calibration {
        Calibration::new(kind, Finding::of(Vec::new(), Vec::new()), basis, around(unix_s))
    }

    #[test]
    fn the_last_record_with_the_present_keys_decides_until_it_expires() {
        let (one, other) = (basis("0.001"), basis("0.002"));
        let mut records = vec![accepted(Kind::Scale, &one, 10)];
        let why = |records: &[Calibration], basis: &Basis, unix_s| {
            holding(Kind::Scale, records, basis, unix_s).map(drop)
        };
        assert_eq!(why(&records, &one, 11), Ok(()));
        assert_eq!(why(&records, &one, 10 + YEAR_S), Err(Why::Expired));
        assert_eq!(why(&records, &other, 11), Err(Why::OtherKeys));
        assert_eq!(why(&[], &one, 11), Err(Why::Never));
        let failed = Finding::failed("nobody saw it".to_owned());
        records.push(Calibration::new(Kind::Scale, failed, &one, around(20)));
        assert_eq!(why(&records, &one, 21), Err(Why::Failed));
        records.push(accepted(Kind::Scale, &one, 30));
        assert_eq!(why(&records, &one, 31), Ok(()));
    }

    #[test]
    fn a_change_of_the_bench_holds_also_when_old_values_are_put_back() {
        let (one, other) = (basis("0.001"), basis("0.002"));
        let mut records = vec![accepted(Kind::Scale, &one, 10), accepted(Kind::Scale, &other, 20)];
        let void = Calibration::void(Kind::Scale, BenchChange::Drive, &other, around(30));
        records.push(void);
        for basis in [&one, &other] {
            assert_eq!(holding(Kind::Scale, &records, basis, 31).map(drop), Err(Why::Changed));
        }
        records.push(accepted(Kind::Scale, &one, 40));
        assert_eq!(holding(Kind::Scale, &records, &one, 41).map(drop), Ok(()));
        assert_eq!(holding(Kind::Scale, &records, &other, 41).map(drop), Err(Why::Changed));
    }

    #[test]
    fn a_change_of_the_bench_holds_also_when_a_port_is_put_back_and_is_not_of_a_simulated_bench() {
        let of = |bus: &str| {
            let text = include_str!("../../../config/rigs/bench.toml");
            let old = "usb-FTDI_USB-RS485_Cable-if00-port0";
            assert!(text.contains(old));
            let rig = RigFile::read("rig.toml", &text.replace(old, bus)).unwrap();
            Basis::of(&rig, [None, None])
        };
        let (one, other) = (of("one"), of("other"));
        let kind = Kind::Geometry;
        let records = vec![
            accepted(kind, &one, 10),
            Calibration::void(kind, BenchChange::Probe, &other, around(20)),
            accepted(kind, &other, 30),
        ];
        let why = |basis: &Basis| holding(kind, &records, basis, 31).map(drop);
        assert_eq!((why(&one), why(&other)), (Err(Why::Changed), Ok(())));
        let simulated = basis("0.001");
        let mut records = vec![accepted(kind, &simulated, 10)];
        records.push(Calibration::void(kind, BenchChange::Probe, &one, around(20)));
        assert_eq!(holding(kind, &records, &simulated, 31).map(drop), Ok(()));
    }

    /// A record as it is, with this number.
    fn numbered(sequence: u64, record: &Calibration) -> Calibration {
        let text = record.to_toml().unwrap();
        let made = format!("sequence = {sequence}\nmade = ");
        Calibration::read(&text.replacen("made = ", &made, 1)).unwrap()
    }

    #[test]
    fn a_record_that_follows_another_one_decides_also_after_the_clock_was_set_back() {
        let basis = basis("0.001");
        let kind = Kind::Homing;
        let failed = Finding::failed("it slips".to_owned());
        for (later, expected) in [
            (Calibration::void(kind, BenchChange::Drive, &basis, around(20)), Err(Why::Changed)),
            (Calibration::new(kind, failed, &basis, around(20)), Err(Why::Failed)),
            (Calibration::begun(kind, &basis, around(20)), Err(Why::Begun)),
            (accepted(kind, &basis, 20), Ok(20)),
        ] {
            // The first one was made while the clock was an hour ahead.
            let early = accepted(kind, &basis, 3600);
            for first in [numbered(1, &early), early] {
                let records = [first, numbered(2, &later)];
                let found = holding(kind, &records, &basis, 21).map(Calibration::made_unix_s);
                assert_eq!(found, expected);
                assert_eq!(is_homing_begun(&records, &basis), expected == Err(Why::Begun));
                let change = last_change(kind, &records, &basis).is_some();
                assert_eq!(change, expected == Err(Why::Changed));
                assert_eq!(last_accepted(kind, &records, &basis).is_none(), change);
            }
        }
        let check = accepted(Kind::Check, &basis, 3600);
        let void = Calibration::void(Kind::Check, BenchChange::Probe, &basis, around(20));
        let records = [numbered(1, &check), numbered(2, &void)];
        assert_eq!(checks(&records, &basis, None), Vec::<&Calibration>::new());
    }

    #[test]
    fn an_accepted_record_of_later_than_now_does_not_hold() {
        let basis = basis("0.001");
        let records = [accepted(Kind::Scale, &basis, 3600)];
        let held = |unix_s| holding(Kind::Scale, &records, &basis, unix_s).map(drop);
        assert_eq!((held(20), held(3600)), (Err(Why::Later), Ok(())));
        // A clock that is kept right goes back a little.
        assert_eq!(held(3599), Ok(()));
        let said = Standing::of(&records, &basis, 20).to_string();
        let why = "scale (its record is dated later than the clock of this computer says now)";
        assert!(said.contains(why), "{said}");
    }

    #[test]
    fn the_last_accepted_record_stays_one_beside_a_failure_until_the_bench_is_changed() {
        let basis = basis("0.001");
        let mut records = vec![accepted(Kind::Sensor, &basis, 10)];
        let failed = Finding::failed("it is another one".to_owned());
        records.push(Calibration::new(Kind::Sensor, failed, &basis, around(20)));
        assert_eq!(last_accepted(Kind::Sensor, &records, &basis), Some(&records[0]));
        records.push(Calibration::void(Kind::Sensor, BenchChange::Sensor, &basis, around(30)));
        assert_eq!(last_accepted(Kind::Sensor, &records, &basis), None);
    }

    #[test]
    fn a_homing_that_has_not_ended_is_seen_until_a_record_follows_also_with_other_keys() {
        let (one, other) = (basis("0.001"), basis("0.002"));
        let mut records = vec![accepted(Kind::Homing, &one, 10)];
        assert!(!is_homing_begun(&records, &one));
        records.push(Calibration::begun(Kind::Homing, &one, around(20)));
        assert!(is_homing_begun(&records, &one) && is_homing_begun(&records, &other));
        assert_eq!(holding(Kind::Homing, &records, &one, 21).map(drop), Err(Why::Begun));
        let text = records[1].to_toml().unwrap();
        assert_eq!(Calibration::read(&text).unwrap(), records[1]);
        let void = Calibration::void(Kind::Homing, BenchChange::Zero, &other, around(30));
        records.push(void);
        assert!(!is_homing_begun(&records, &one));
        assert_eq!(holding(Kind::Homing, &records, &one, 31).map(drop), Err(Why::Changed));
    }
}
