//! The paper's claims, one by one: what holds, what does not, and what cannot be decided.

mod bounds;
mod equations;
mod experiment;
mod recognition;
mod sensor;

use crate::page::{Page, Table};

/// A claim with its verdict and the numbers that it rests on.
#[derive(Clone)]
struct Claim {
    place: &'static str,
    says: &'static str,
    verdict: Verdict,
    numbers: String,
}

fn claim(
    place: &'static str,
    says: &'static str,
    verdict: Verdict,
    numbers: impl Into<String>,
) -> Claim {
    Claim { place, says, verdict, numbers: numbers.into() }
}

#[derive(Clone, Copy)]
enum Verdict {
    Holds,
    HoldsInPart,
    DoesNotHold,
    Undecided,
}

impl Verdict {
    const fn name(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::HoldsInPart => "holds in part",
            Self::DoesNotHold => "does not hold",
            Self::Undecided => "cannot be decided",
        }
    }
}

pub(super) fn add(page: &mut Page) {
    page.heading("Claim by claim");
    let mut table = Table::new(&["place", "claim", "verdict", "numbers"]);
    let all = [
        equations::claims(),
        bounds::claims(),
        sensor::claims(),
        recognition::claims(),
        experiment::claims(),
    ];
    for claims in all {
        for Claim { place, says, verdict, numbers } in claims {
            table.row([place.to_owned(), says.to_owned(), verdict.name().to_owned(), numbers]);
        }
    }
    page.table(table);
}
