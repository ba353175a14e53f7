//! Subjects of messages: `state.LAB.BENCH` and `live.LAB.BENCH.KIND`.

use crate::BenchName;

/// The subjects of a bench.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subjects {
    lab: String,
    bench: String,
}

impl Subjects {
    /// The subjects of this bench.
    pub fn of(bench: &BenchName) -> Self {
        Self { lab: token(&bench.lab), bench: token(&bench.name) }
    }

    /// Its state, sent at each change and repeated.
    pub fn state(&self) -> String {
        format!("state.{}.{}", self.lab, self.bench)
    }

    /// Records of a kind.
    pub fn events(&self, kind: &str) -> String {
        format!("live.{}.{}.{}", self.lab, self.bench, token(kind))
    }

    /// All that a bench may send.
    pub(super) fn all(&self) -> [String; 2] {
        [self.state(), format!("live.{}.{}.>", self.lab, self.bench)]
    }
}

/// States and events of all benches of a laboratory.
pub(super) fn all_of(lab: &str) -> [String; 2] {
    ["state", "live"].map(|what| format!("{what}.{}.>", token(lab)))
}

/// The bench of a subject, and the kind of its record; none for a state.
pub(super) fn read(subject: &str) -> Option<(BenchName, Option<String>)> {
    let parts: Vec<_> = subject.split('.').map(|part| part.replace(':', ".")).collect();
    match &parts[..] {
        [state, lab, name] if state == "state" => {
            Some((BenchName { lab: lab.clone(), name: name.clone() }, None))
        }
        [live, lab, name, kind] if live == "live" => {
            Some((BenchName { lab: lab.clone(), name: name.clone() }, Some(kind.clone())))
        }
        _ => None,
    }
}

/// A name as one part of a subject. Points separate these, and names of benches have no colon.
fn token(name: &str) -> String {
    name.replace('.', ":")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_subject_says_bench_and_kind() {
        for name in ["lab/left", "soft-matter/left.2", "a.b.c/d_e"] {
            let bench: BenchName = name.parse().unwrap();
            let subjects = Subjects::of(&bench);
            assert_eq!(subjects.state().split('.').count(), 3);
            assert_eq!(read(&subjects.state()), Some((bench.clone(), None)));
            let event = subjects.events("touch_result");
            assert_eq!(read(&event), Some((bench, Some("touch_result".to_owned()))));
        }
        for other in ["state.lab", "live.lab.left", "other.lab.left", "live.a.b.c.d", ""] {
            assert_eq!(read(other), None, "{other}");
        }
    }

    #[test]
    fn no_bench_has_the_subjects_of_another_one() {
        let [one, other] = ["lab/left.right", "lab.left/right"]
            .map(|name| Subjects::of(&name.parse::<BenchName>().unwrap()));
        assert_ne!(one.state(), other.state());
        assert_eq!(one.all(), ["state.lab.left:right", "live.lab.left:right.>"]);
    }
}
