//! The assessment of the paper's claims.

mod bounds;
mod equations;
mod experiment;
mod probe;
mod recognition;
mod sensor;

use crate::page::{Page, Table};

/// A claim with its assessment and the supporting numbers.
#[derive(Clone)]
struct Claim {
    section: &'static str,
    statement: &'static str,
    assessment: Assessment,
    numbers: String,
}

fn claim(
    section: &'static str,
    statement: &'static str,
    assessment: Assessment,
    numbers: impl Into<String>,
) -> Claim {
    Claim { section, statement, assessment, numbers: numbers.into() }
}

#[derive(Clone, Copy)]
enum Assessment {
    Holds,
    HoldsInPart,
    DoesNotHold,
    Undecided,
}

impl Assessment {
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
    let mut table = Table::new(&["section", "claim", "assessment", "numbers"]);
    let all = [
        equations::claims(),
        bounds::claims(),
        sensor::claims(),
        probe::claims(),
        recognition::claims(),
        experiment::claims(),
    ];
    for claims in all {
        for Claim { section, statement, assessment, numbers } in claims {
            table.row([
                section.to_owned(),
                statement.to_owned(),
                assessment.name().to_owned(),
                numbers,
            ]);
        }
    }
    page.table(table);
}
