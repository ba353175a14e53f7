//! A campaign from a work queue of NATS `JetStream`, for workers on many computers.

use std::{io, ops::Range, path::Path, time::Instant};

use rig_workqueue::{Action, Asked, CHUNKS_MAX, Chunk, Work, cut};
use rigd::program;

use crate::{
    Arguments,
    campaign::{Campaign, Counts},
    ledger::{self, Ledger, LedgerError, Piece},
    write_page,
};

/// Why a queue is of no use to a campaign.
#[derive(Debug, thiserror::Error)]
pub(crate) enum QueueError {
    #[error(transparent)]
    Queue(#[from] rig_workqueue::QueueError),
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    #[error("standard output")]
    Output(#[from] io::Error),
    #[error("seeds {} to {} are {chunks} chunks, and {CHUNKS_MAX} are allowed: take a larger --chunk", seeds.start, seeds.end - 1)]
    Many { seeds: Range<u64>, chunks: u64 },
    #[error("the piece of seeds {} to {} in the queue is one of others, of the program {program}", seeds.start, seeds.end - 1)]
    Foreign { seeds: Range<u64>, program: String },
}

/// Does what is asked for with the queue. `play` plays the seeds of the arguments.
///
/// # Errors
/// [`QueueError`].
pub(crate) fn run(
    asked: &Asked<'_>,
    arguments: &Arguments,
    play: impl Fn(&Arguments, &Campaign) -> Counts,
) -> Result<(), QueueError> {
    let (content, program) = (ledger::menu(), program::digest().map_err(LedgerError::from)?);
    let queue = asked.connect(Work {
        kind: "campaign",
        noun: "seed",
        alone: "play them alone, with --first-seed and --seeds,",
        title: format!("the menu {content}"),
        content,
        program: program.clone(),
    })?;
    match asked.action {
        Action::Fill(redelivery) => {
            let (seeds, size) = (arguments.range(), arguments.chunk);
            let chunks = arguments.seeds.div_ceil(size);
            if chunks > CHUNKS_MAX {
                return Err(QueueError::Many { seeds, chunks });
            }
            let cut: Vec<_> = cut(seeds, size).collect();
            println!("{}", queue.fill(&cut, redelivery)?);
            Ok(())
        }
        Action::Gather(within) => {
            let page = arguments.page.as_deref().expect("--gather requires it");
            // A ledger that cannot take the pieces is noticed before they are waited for.
            let mut all = Ledger::read(page)?;
            all.admits(page, &arguments.range())?;
            let pieces = queue.gather(&arguments.range(), within)?;
            println!("{} pieces", pieces.len());
            merge(&mut all, page, pieces, &program)?;
            all.write(page)?;
            println!("{}", all.counts());
            Ok(write_page(page, &all)?)
        }
        Action::Work(within) => {
            let campaign = Campaign::default();
            queue.work(within, &mut io::stdout(), |chunk| {
                let Chunk { first: first_seed, count: seeds } = chunk;
                let begun = Instant::now();
                let arguments = Arguments { first_seed, seeds, ..arguments.clone() };
                let counts = play(&arguments, &campaign);
                let (seconds, jobs) = (begun.elapsed().as_secs_f64(), arguments.jobs);
                let (software, program) = (rigd::rig::SOFTWARE.to_owned(), program.clone());
                let said = counts.to_string();
                Ok::<_, QueueError>((
                    Piece { first_seed, seeds, jobs, seconds, software, program, counts },
                    said,
                ))
            })
        }
    }
}

/// Merges pieces into the ledger of the page. Each must be what its chunk says.
fn merge(
    all: &mut Ledger,
    page: &Path,
    pieces: Vec<(Chunk, Piece)>,
    program: &str,
) -> Result<(), QueueError> {
    let is_other = |(chunk, piece): &&(Chunk, Piece)| {
        piece.range() != chunk.range() || piece.program != program
    };
    if let Some((chunk, piece)) = pieces.iter().find(is_other) {
        let (seeds, program) = (chunk.range(), piece.program.clone());
        return Err(QueueError::Foreign { seeds, program });
    }
    let pieces = pieces.into_iter().map(|(_, piece)| piece).collect();
    Ok(all.merge(page, Ledger { pieces, ..Ledger::new(ledger::menu()) })?)
}

#[cfg(test)]
mod tests;
