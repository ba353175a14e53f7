//! The variants of a model that the page compares.

use rig_contact::{ContactLaw, Tier};

use crate::paper_bench::Control;

/// A variant of a model: a tier, a contact law, and the held quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Variant {
    pub(super) tier: Tier,
    pub(super) law: ContactLaw,
    pub(super) control: Control,
}

impl Variant {
    /// All variants worth a comparison: both forms of the same contact, without refused ones.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let laws = [ContactLaw::SneddonSeries, ContactLaw::Sneddon];
        Tier::ALL.into_iter().flat_map(move |tier| {
            laws.into_iter().flat_map(move |law| {
                Control::ALL
                    .into_iter()
                    .filter(move |&control| {
                        control == Control::Indentation || tier.validity().takes_stage_moves
                    })
                    .map(move |control| Self { tier, law, control })
            })
        })
    }
}
