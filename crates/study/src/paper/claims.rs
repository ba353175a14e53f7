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
    page.text(
        "The printed tables: Table 1 (materials) and Table 2 (stiffnesses 0.045, 0.104, 0.235, 0.320 \
         and 0.649 MPa) are inputs and used as printed. The text says that lumps are 5 to 15 times as \
         stiff as normal tissue; its own samples 2 to 5 are 2.3, 5.2, 7.1 and 14.4 times as stiff as \
         sample 1. Table 3 is judged above.",
    );
}
