//! Ports: whether they open, who else has them open, and how fast they are.

use rig_model::with_causes;

use super::{Finding, Findings, advice::on_port};
use crate::rig::{PortSeen, RoundTrips};

/// Longest latency timer of a USB adapter that forwards received bytes at once, ms.
const ADAPTER_DELAY_BEST_MS: u32 = 1;

/// Devices in order send half of their answers within this time, ms. The driver waits for a drive
/// for 100 ms.
const ROUND_TRIP_MAX_MS: f64 = 50.0;

pub(super) fn findings(port: &PortSeen) -> Vec<Finding> {
    let mut findings = Findings::of(port.role);
    let facts = match &port.outcome {
        Ok(facts) => facts,
        Err(error) => {
            findings.problem("open", with_causes(error), on_port(error));
            return findings.all;
        }
    };
    findings.ok("open", &port.name);
    if !facts.intruders.is_empty() {
        let names: Vec<_> = facts.intruders.iter().map(ToString::to_string).collect();
        let text = format!("also open in {}", names.join(", "));
        // Whether it does any harm, the devices tell.
        let advice = "end that program: it may take answers away";
        findings.warning("other programs", text, advice);
    }
    match facts.adapter_delay_ms {
        Some(delay) if delay > ADAPTER_DELAY_BEST_MS => findings.warning(
            "adapter",
            format!("may hold back received bytes for {delay} ms"),
            "write 1 into latency_timer of the adapter, below /sys/bus/usb-serial/devices",
        ),
        Some(delay) => findings.ok("adapter", format!("hands on within {delay} ms")),
        None => {}
    }
    if let Some(RoundTrips { count, median_ms, longest_ms }) = facts.round_trips {
        let text =
            format!("median {median_ms:.1} ms, longest {longest_ms:.1} ms of {count} round trips");
        if median_ms > ROUND_TRIP_MAX_MS {
            let advice = "look for a slow network or gateway between, or a slow line";
            findings.warning("latency", text, advice);
        } else {
            findings.ok("latency", text);
        }
    }
    findings.all
}
