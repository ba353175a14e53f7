//! The tiers: description, validity, cost and agreement.

use rig_contact::{ContactLaw, Tier};

use super::{
    agreement::measure,
    cost::{Costs, ImpedanceCosts, ratio, unit_ns},
    variant::Variant,
};
use crate::{
    page::{Page, Table},
    paper_bench::Control,
};

pub(super) fn add(page: &mut Page, costs: &Costs, of_impedance: &ImpedanceCosts) {
    page.heading("The tiers");
    page.text(
        "A tier refuses contacts outside its validity: a contact above its limit of stiffness \
         relative to the sensor's tip, a move of the stage if it does not model the static \
         deflection of the sensor, or a force that turns the end of the sensor by more than 8.6° if \
         it models that force. Cost and difference are those with the series contact radius and the \
         indentation held, or the stage held for T2s and E1s; the charts below show the other \
         combinations.",
    );
    let mut table = Table::new(&[
        "tier",
        "description",
        "stiffness ratio up to",
        "stage moves",
        "impedance",
        "cost, over E1",
        "largest difference from the reference, Hz",
    ]);
    for tier in Tier::ALL {
        let validity = tier.validity();
        let control = match tier {
            Tier::T2s | Tier::E1s => Control::Stage,
            _ => Control::Indentation,
        };
        let variant = Variant { tier, law: ContactLaw::SneddonSeries, control };
        let difference = match tier {
            Tier::Reference => "the reference".to_owned(),
            _ => format!("{:.2}", measure(variant, control).max_hz),
        };
        let yes = |is: bool| if is { "yes" } else { "no" }.to_owned();
        table.row([
            tier.name().to_owned(),
            description(tier).to_owned(),
            if validity.stiffness_ratio_max.is_finite() {
                validity.stiffness_ratio_max.to_string()
            } else {
                "any".to_owned()
            },
            yes(validity.takes_stage_moves),
            yes(validity.has_impedance),
            costs.get(&variant).map_or(String::new(), |ns| ratio(ns / unit_ns(costs))),
            difference,
        ]);
    }
    page.table(table);
    page.text(format!(
        "A cost is the time of one evaluation over that of E1, {:.0} ns on the computer that measured. \
         The cost of an impedance:",
        unit_ns(costs)
    ));
    let mut table = Table::new(&["step", "cost, over E1"]);
    for (step, ns) in of_impedance {
        table.row([(*step).to_owned(), ratio(ns / unit_ns(costs))]);
    }
    page.table(table);
}

const fn description(tier: Tier) -> &'static str {
    match tier {
        Tier::T0 => "equation (7): proportional to the contact stiffness",
        Tier::T0b => "equation (7) with the loaded sensor's frequency",
        Tier::T1 => "one mass between two springs",
        Tier::T2 => "T1 with tangential stiffness, tilt and probe arm",
        Tier::T2s => "T2 with static deflection",
        Tier::E1 => "one beam element in closed form, under the static force of the contact",
        Tier::E1s => "E1 with static deflection",
        Tier::Exact => "the exact beam without losses, under the static force",
        Tier::Reference => {
            "sixteen elements in space with losses and electrodes, under the static force"
        }
    }
}
