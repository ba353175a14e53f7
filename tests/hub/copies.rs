//! Copies of a run that was measured, as other runs of other benches: with ids and seals of their own, and the same records.

use rig_hub::Batch;
use rig_store::{ListEntry, Reader, Run, RunId, SealedRun, Shipment};
use tokio_postgres::Client;

/// Records of a batch at most, as a bench sends them.
const RECORDS_MAX: usize = 1000;
const BYTES_MAX: usize = 1 << 20;
/// Kinds of records that have typed rows, or change what a rig is seen to do.
const KINDS: [&str; 7] = [
    "run_started",
    "operator",
    "touch_result",
    "touch_refused",
    "fault",
    "state_changed",
    "run_finished",
];

/// A run that can be copied.
#[derive(Debug, Clone)]
pub(crate) struct Template {
    sealed: SealedRun,
    shipment: Shipment,
}

impl Template {
    /// A sealed run of a journal.
    pub(crate) fn of(reader: &Reader, run: &Run) -> Self {
        let (sealed, records) = reader.sealed(run.id).unwrap();
        let ends = reader.shipment(0, u32::MAX, usize::MAX).unwrap().ends;
        let ends = ends.into_iter().filter(|end| end.run == run.id).collect();
        Self { sealed, shipment: Shipment { records, ends, ..Shipment::default() } }
    }

    /// The same run with the records alone that have typed rows.
    pub(crate) fn thin(&self) -> Self {
        let mut thin = self.clone();
        thin.shipment.records.retain(|record| KINDS.contains(&&*record.kind));
        let mut head = rig_store::Digest::START;
        for (record, seq) in thin.shipment.records.iter_mut().zip(1..) {
            head = head.next(seq, record.rig_us, &record.kind, &record.payload);
            (record.seq, record.digest) = (seq, head);
        }
        thin.sealed.records = thin.shipment.records.len() as u64;
        thin.sealed.head = head;
        thin
    }

    /// Number of records.
    pub(crate) fn records(&self) -> usize {
        self.shipment.records.len()
    }

    /// Number of touches with a shift.
    pub(crate) fn touches(&self) -> usize {
        self.shipment.records.iter().filter(|record| record.kind == "touch_result").count()
    }

    /// Bytes of the payloads.
    pub(crate) fn bytes(&self) -> usize {
        self.shipment.records.iter().map(|record| record.payload.len()).sum()
    }

    /// When each record was made, µs after the first one.
    pub(crate) fn times_us(&self) -> Vec<u64> {
        let records = &self.shipment.records;
        records.iter().map(|record| record.rig_us - records[0].rig_us).collect()
    }

    /// A copy with a number, of a journal, that began so long after 2026 began, whose events follow `event`.
    pub(crate) fn copy(&self, number: u64, journal: &str, began_s: u64, event: u64) -> Shipment {
        let run: RunId = run_id(number, began_s).parse().unwrap();
        let mut sealed = self.sealed.clone();
        sealed.entry = ListEntry {
            run: run.to_string(),
            journal: journal.to_owned(),
            started_at: time(began_s),
            ..sealed.entry
        };
        for stretch in &mut sealed.stretches {
            stretch.started_at = time(began_s);
        }
        sealed.finished_at = time(began_s + 1510);
        let mut shipment = self.shipment.clone();
        for (record, event) in shipment.records.iter_mut().zip(event + 1..) {
            (record.run, record.event) = (run, event);
        }
        for end in &mut shipment.ends {
            (end.run, end.finished_at) = (run, sealed.finished_at.clone());
            (end.records, end.head, end.seal) = (sealed.records, sealed.head, Some(sealed.seal()));
        }
        let stretches = sealed.stretches.iter();
        shipment.stretches = stretches.map(|stretch| (run.to_string(), stretch.clone())).collect();
        shipment.entries = vec![sealed.entry];
        shipment
    }
}

/// A UUID of version 7 for a time.
fn run_id(number: u64, began_s: u64) -> String {
    let ms = 1_767_225_600_000 + began_s * 1000;
    let (high, low) = (ms >> 16, ms & 0xffff);
    format!("{high:08x}-{low:04x}-7000-8000-{number:012x}")
}

/// So many seconds after 2026 began, as a journal writes it.
fn time(seconds: u64) -> String {
    const MONTHS: [u64; 12] = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let (mut day, second) = (seconds / 86_400 % 365, seconds % 86_400);
    let mut month = 0;
    while day >= MONTHS[month] {
        day -= MONTHS[month];
        month += 1;
    }
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("2026-{:02}-{:02}T{hour:02}:{minute:02}:{:02}.000Z", month + 1, day + 1, second % 60)
}

/// A bench that ships copies over a connection of its own.
pub(crate) struct Copier {
    client: Client,
    pub(crate) journal: String,
    pub(crate) event: u64,
    digest: String,
}

impl Copier {
    /// Greets the hub for the journal with this number.
    pub(crate) async fn open(client: Client, number: u64) -> Self {
        let journal = format!("00000000-0000-7000-9000-{number:012x}");
        let greet = "SELECT (c).event FROM hub.greet($1::text::uuid, 'rigd 0') AS c";
        let event: i64 = client.query_one(greet, &[&journal]).await.unwrap().get(0);
        assert_eq!(event, 0, "a journal that is known");
        Self { client, journal, event: 0, digest: String::new() }
    }

    /// Sends a part of a run, in batches as a bench makes them.
    pub(crate) async fn send(&mut self, whole: &Shipment, from: usize, to: usize) {
        let mut from = from;
        while from < to {
            let mut bytes = 0;
            let fits = whole.records[from..to].iter().take(RECORDS_MAX).take_while(|record| {
                let is_first = bytes == 0;
                bytes += record.payload.len();
                is_first || bytes < BYTES_MAX
            });
            let until = from + fits.count();
            let is_last = until == whole.records.len();
            let part = Shipment {
                records: whole.records[from..until].to_vec(),
                entries: whole.entries.clone(),
                stretches: whole.stretches.clone(),
                ends: if is_last { whole.ends.clone() } else { Vec::new() },
            };
            let batch = Batch::new(self.event, &self.digest, &part).unwrap();
            let ingest =
                "SELECT (c).event FROM hub.ingest($1::text::uuid, $2, $3::text::json) AS c";
            let after = self.event.cast_signed();
            let row = self.client.query_one(ingest, &[&self.journal, &after, &batch.json()]).await;
            let event: i64 = row.unwrap().get(0);
            self.event = batch.last_event;
            assert_eq!(event.cast_unsigned(), self.event, "the hub has not taken a batch");
            self.digest = whole.records[until - 1].digest.to_string();
            from = until;
        }
    }
}
