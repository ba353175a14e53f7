//! The pieces of a campaign that was played in several sessions, each with the program that played it.

use std::{
    fs, io,
    ops::Range,
    path::{Path, PathBuf},
};

use rigd::program::{ProgramError, head_of};
use serde::{Deserialize, Serialize};

use crate::{
    bench::Bench,
    campaign::{Counts, drawn},
    faults::MENU,
};

/// The pieces of one menu, in the order of their seeds. No seed is in two of them.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ledger {
    /// What the seeds draw, as [`menu`] says it.
    pub(crate) menu: String,
    pub(crate) pieces: Vec<Piece>,
    /// What was counted with other menus before.
    #[serde(default)]
    pub(crate) earlier: Vec<Earlier>,
}

/// The counts of all seeds of a menu that is not played any more.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Earlier {
    pub(crate) menu: String,
    pub(crate) runs: u64,
    pub(crate) touches: u64,
    pub(crate) faults: u64,
    pub(crate) failed_seeds: Vec<u64>,
    /// Version and commit of each program.
    pub(crate) software: Vec<String>,
}

/// Seeds that one program played in a row.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Piece {
    pub(crate) first_seed: u64,
    pub(crate) seeds: u64,
    pub(crate) jobs: usize,
    pub(crate) seconds: f64,
    /// Version and commit.
    pub(crate) software: String,
    /// The first digits of the SHA-256 of the program's file.
    pub(crate) program: String,
    pub(crate) counts: Counts,
}

impl Piece {
    /// The seeds that were played.
    pub(crate) fn range(&self) -> Range<u64> {
        self.first_seed..self.first_seed.saturating_add(self.seeds)
    }
}

/// Why there is no ledger to add to.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LedgerError {
    #[error("{}", path.display())]
    File { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Program(#[from] ProgramError),
    #[error("{} is not a ledger of this campaign", path.display())]
    Format { path: PathBuf, source: serde_json::Error },
    #[error(
        "{} is of the menu {known}, and the seeds are of the menu {present}: play some with --begin-anew, which keeps \
         the sums of its pieces", path.display()
    )]
    Menu { path: PathBuf, known: String, present: String },
    #[error(
        "seeds {} to {} are in part those of the piece {} to {}; play all of them again, or others",
        asked.start, asked.end - 1, known.start, known.end - 1
    )]
    Overlap { asked: Range<u64>, known: Range<u64> },
    #[error(
        "seeds {} to {} were played by the programs {} and {}: leave one of the pieces out",
        seeds.start, seeds.end - 1, programs[0], programs[1]
    )]
    Programs { seeds: Range<u64>, programs: [String; 2] },
    #[error(
        "seeds {} to {} were played twice by the program {program}, and the runs have the digests {:016x} and \
         {:016x}: one of the pieces is damaged, or the runs do not depend on their seeds alone",
        seeds.start, seeds.end - 1, digests[0], digests[1]
    )]
    Digests { seeds: Range<u64>, program: String, digests: [u64; 2] },
}

/// The file of the ledger beside its page.
fn beside(page: &Path) -> PathBuf {
    page.with_extension("json")
}

/// Seeds and benches that stand for all others in the digest of a menu.
const SPECIMENS: u64 = 32;

/// The first digits of a digest of what seeds draw: with another menu, a seed plays something else.
pub(crate) fn menu() -> String {
    let drawn = (0..SPECIMENS).map(|number| {
        let benches = [Bench::new(number), Bench::descending(number)];
        format!("{:?}{}{}", drawn(number), benches[0], benches[1])
    });
    head_of(format!("{MENU:?}{}", drawn.collect::<String>()))
}

impl Ledger {
    /// A ledger without pieces.
    pub(crate) const fn new(menu: String) -> Self {
        Self { menu, pieces: Vec::new(), earlier: Vec::new() }
    }

    /// The ledger of the present menu: if it is of another one, its pieces are summed up.
    pub(crate) fn begun_anew(mut self) -> Self {
        let present = menu();
        if self.menu == present {
            return self;
        }
        let counts = self.counts();
        let mut software: Vec<String> =
            self.pieces.into_iter().map(|piece| piece.software).collect();
        software.sort();
        software.dedup();
        let (menu, faults) = (self.menu, counts.table.total());
        let Counts { runs, touches, failed_seeds, .. } = counts;
        self.earlier.push(Earlier { menu, runs, touches, faults, failed_seeds, software });
        Self { menu: present, pieces: Vec::new(), earlier: self.earlier }
    }

    /// The ledger beside a page; a new one of the present menu if there is none.
    pub(crate) fn read(page: &Path) -> Result<Self, LedgerError> {
        let path = beside(page);
        match fs::read_to_string(&path) {
            Ok(text) => {
                serde_json::from_str(&text).map_err(|source| LedgerError::Format { path, source })
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Self::new(menu())),
            Err(source) => Err(LedgerError::File { path, source }),
        }
    }

    /// Whether these seeds can be added to the ledger of this page: a known piece is replaced as a whole or
    /// not at all, and seeds of another menu are others.
    pub(crate) fn admits(&self, page: &Path, asked: &Range<u64>) -> Result<(), LedgerError> {
        let present = menu();
        if self.menu != present && !asked.is_empty() {
            let (path, known) = (beside(page), self.menu.clone());
            return Err(LedgerError::Menu { path, known, present });
        }
        for piece in &self.pieces {
            let known = piece.range();
            let is_apart = known.end <= asked.start || asked.end <= known.start;
            let is_replaced = asked.start <= known.start && known.end <= asked.end;
            if !(is_apart || is_replaced) {
                return Err(LedgerError::Overlap { asked: asked.clone(), known });
            }
        }
        Ok(())
    }

    /// Adds a piece that was admitted, in the place of those whose seeds it has.
    pub(crate) fn add(&mut self, piece: Piece) {
        let new = piece.range();
        self.pieces.retain(|old| !(new.start <= old.range().start && old.range().end <= new.end));
        self.pieces.push(piece);
        self.pieces.sort_by_key(|piece| piece.first_seed);
    }

    /// Adds the pieces of another ledger. Of two pieces with the same seeds the faster one stays: the runs are the same.
    ///
    /// # Errors
    /// Another menu, seeds that are in part those of another piece, and the same seeds with other runs.
    pub(crate) fn merge(&mut self, page: &Path, other: Self) -> Result<(), LedgerError> {
        let is_begun = !self.pieces.is_empty() || !self.earlier.is_empty();
        if self.menu != other.menu && is_begun {
            let (path, known) = (beside(page), self.menu.clone());
            return Err(LedgerError::Menu { path, known, present: other.menu });
        }
        self.menu = other.menu;
        for earlier in other.earlier {
            if !self.earlier.contains(&earlier) {
                self.earlier.push(earlier);
            }
        }
        for piece in other.pieces {
            let seeds = piece.range();
            match self.pieces.iter().find(|known| known.range() == seeds) {
                None => {
                    let overlaps = |known: &&Piece| {
                        known.range().start < seeds.end && seeds.start < known.range().end
                    };
                    if let Some(known) = self.pieces.iter().find(overlaps) {
                        return Err(LedgerError::Overlap { asked: seeds, known: known.range() });
                    }
                }
                Some(known) if known.program != piece.program => {
                    let programs = [known.program.clone(), piece.program];
                    return Err(LedgerError::Programs { seeds, programs });
                }
                Some(known) if known.counts.digest != piece.counts.digest => {
                    let digests = [known.counts.digest, piece.counts.digest];
                    return Err(LedgerError::Digests { seeds, program: piece.program, digests });
                }
                Some(known) if known.seconds <= piece.seconds => continue,
                Some(_) => {}
            }
            self.add(piece);
        }
        Ok(())
    }

    /// The counts of all pieces.
    pub(crate) fn counts(&self) -> Counts {
        let mut all = Counts::default();
        for piece in &self.pieces {
            all.merge(&piece.counts);
        }
        all
    }

    /// Writes the ledger beside its page.
    pub(crate) fn write(&self, page: &Path) -> Result<(), LedgerError> {
        let path = beside(page);
        let error = |source| LedgerError::Format { path: path.clone(), source };
        let text = serde_json::to_string_pretty(self).map_err(error)?;
        fs::write(&path, text + "\n").map_err(|source| LedgerError::File { path, source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(first_seed: u64, seeds: u64, touches: u64) -> Piece {
        let counts =
            Counts { runs: seeds, touches, failed_seeds: vec![first_seed], ..Counts::default() };
        let (software, program) = ("rigd".to_owned(), "0".repeat(16));
        Piece { first_seed, seeds, jobs: 1, seconds: 1.0, software, program, counts }
    }

    #[test]
    fn a_seed_is_counted_once_and_a_piece_is_replaced_as_a_whole() {
        let (mut ledger, page) = (Ledger::new(menu()), Path::new("campaign.md"));
        for piece in [piece(101, 100, 7), piece(1, 100, 5)] {
            ledger.admits(page, &piece.range()).unwrap();
            ledger.add(piece);
        }
        let counts = ledger.counts();
        assert_eq!((counts.runs, counts.touches, counts.failed_seeds), (200, 12, vec![1, 101]));
        for part in [50..150, 1..100, 200..300] {
            assert!(ledger.admits(page, &part).is_err(), "{part:?}");
        }
        ledger.admits(page, &(1..201)).unwrap();
        let other = Ledger::new("0".repeat(16));
        assert!(matches!(other.admits(page, &(300..301)), Err(LedgerError::Menu { .. })));
        other.admits(page, &(300..300)).unwrap();
        ledger.add(piece(1, 200, 11));
        assert_eq!((ledger.pieces.len(), ledger.counts().touches), (1, 11));
    }

    #[test]
    fn pieces_of_several_computers_give_one_ledger_in_any_order_and_as_often_as_you_like() {
        let page = Path::new("campaign.md");
        let of = |pieces: &[Piece]| Ledger { pieces: pieces.to_vec(), ..Ledger::new(menu()) };
        let (one, two) = (of(&[piece(1, 100, 5), piece(201, 100, 7)]), of(&[piece(101, 100, 6)]));
        let slower = of(&[Piece { seconds: 2.0, ..piece(101, 100, 6) }]);
        let merged = |ledgers: &[&Ledger]| {
            let mut all = Ledger::new(menu());
            for ledger in ledgers {
                all.merge(page, of(&ledger.pieces)).unwrap();
            }
            serde_json::to_string(&all).unwrap()
        };
        let expected = merged(&[&one, &two]);
        for others in [&[&two, &one][..], &[&slower, &one, &two], &[&two, &one, &slower, &one]] {
            assert_eq!(merged(others), expected);
        }

        let mut all = Ledger::new(menu());
        all.merge(page, one).unwrap();
        let mut refused = |piece: Piece| all.merge(page, of(&[piece])).unwrap_err();
        assert!(matches!(refused(piece(50, 100, 0)), LedgerError::Overlap { .. }));
        let other = Piece { program: "1".repeat(16), ..piece(1, 100, 5) };
        assert!(matches!(refused(other), LedgerError::Programs { .. }));
        let mut other = piece(1, 100, 5);
        other.counts.digest = 1;
        assert!(matches!(refused(other), LedgerError::Digests { .. }));
        let other = || Ledger { pieces: vec![piece(301, 100, 0)], ..Ledger::new("0".repeat(16)) };
        assert!(matches!(all.merge(page, other()), Err(LedgerError::Menu { .. })));
        // An old ledger is not begun again, and its sums are kept once.
        let mut anew = other().begun_anew();
        assert!(matches!(anew.merge(page, other()), Err(LedgerError::Menu { .. })));
        for _ in 0..2 {
            all.merge(page, other().begun_anew()).unwrap();
        }
        assert_eq!((all.earlier.len(), all.pieces.len()), (1, 2));
    }

    #[test]
    fn a_ledger_that_is_begun_anew_keeps_the_sums_of_another_menu_and_nothing_of_its_own() {
        let pieces = vec![piece(1, 100, 5), piece(101, 100, 7)];
        let own = Ledger { pieces: pieces.clone(), ..Ledger::new(menu()) }.begun_anew();
        assert_eq!((own.pieces.len(), own.earlier.len()), (2, 0));
        let old = Ledger { pieces, ..Ledger::new("0".repeat(16)) };
        let anew = old.begun_anew();
        assert_eq!((&*anew.menu, anew.pieces.len()), (&*menu(), 0));
        let kept = &anew.earlier[0];
        assert_eq!((kept.runs, kept.touches, &kept.failed_seeds), (200, 12, &vec![1, 101]));
        assert_eq!((&*kept.menu, &kept.software), (&*"0".repeat(16), &vec!["rigd".to_owned()]));
        anew.admits(Path::new("campaign.md"), &(1..100)).unwrap();
    }

    #[test]
    fn what_is_read_is_what_was_written_and_another_menu_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("campaign.md");
        assert!(Ledger::read(&page).unwrap().pieces.is_empty());
        let mut ledger = Ledger::new(menu());
        let mut piece = piece(1, 100, 5);
        piece.counts.table.add(3, crate::counts::PHASES[2]);
        ledger.add(piece);
        ledger.write(&page).unwrap();
        let read = Ledger::read(&page).unwrap();
        assert_eq!(format!("{read:?}"), format!("{ledger:?}"));
        let text = fs::read_to_string(beside(&page)).unwrap();
        fs::write(beside(&page), text.replace("bus: connection breaks", "bus: eaten")).unwrap();
        assert!(matches!(Ledger::read(&page), Err(LedgerError::Format { .. })));
    }
}
