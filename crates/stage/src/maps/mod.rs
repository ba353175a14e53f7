//! The register maps that are shipped.

mod iai_rc;
mod leadshine_pr;
mod oriental_az;

pub use iai_rc::IAI_RC;
pub use leadshine_pr::LEADSHINE_PR;
pub use oriental_az::ORIENTAL_AZ;

use rig_model::DriveMake;

use crate::RegisterMap;

impl RegisterMap {
    /// The registers of drives of this make.
    pub const fn of(make: DriveMake) -> &'static Self {
        match make {
            DriveMake::OrientalAz => &ORIENTAL_AZ,
            DriveMake::IaiRc => &IAI_RC,
            DriveMake::LeadshinePr => &LEADSHINE_PR,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{AlarmSource, Block, Field, Flag, RegisterContent, Step, Table, Width};

    fn contains(block: Block, address: u16, n: u16) -> bool {
        block.address <= address && address + n <= block.address + block.count
    }

    /// Registers of a slot.
    fn len(content: RegisterContent) -> u16 {
        match content {
            RegisterContent::Word(_) | RegisterContent::Of(_, Width::U16) => 1,
            RegisterContent::Long(_) | RegisterContent::Of(_, Width::I32) => 2,
        }
    }

    #[test]
    fn every_field_and_flag_lies_in_its_block() {
        for map in DriveMake::ALL.map(RegisterMap::of) {
            let field = |field: Field| {
                let n = if field.width == Width::I32 { 2 } else { 1 };
                assert!(contains(map.status[field.block], field.address, n), "{}", map.make);
            };
            let flag = |flag: Flag| {
                let block = map.status[flag.block];
                assert!(contains(block, flag.address, 1), "{}: {flag:?}", map.make);
                let is_word = matches!(block.table, Table::Holding | Table::Input);
                assert!(flag.bit < if is_word { 16 } else { 1 }, "{}: {flag:?}", map.make);
            };
            for &(address, width, min, max) in map.signature.ranges {
                let n = if width == Width::I32 { 2 } else { 1 };
                assert!(contains(map.signature.read, address, n), "{}: {address:#06x}", map.make);
                assert!(0 < min && min <= max, "{}: a drive of zeros would do", map.make);
            }
            assert_ne!(map.signature.read.count, map.settings.read.count, "{}", map.make);
            field(map.position);
            field(map.target.field());
            for known in [map.moving, map.ready, map.homed] {
                flag(known);
            }
            match map.alarm {
                AlarmSource::Code(code) => field(code),
                AlarmSource::Flagged { flag: is_set, .. } => flag(is_set),
            }
        }
    }

    #[test]
    fn no_two_answers_of_a_map_have_the_same_length() {
        for map in DriveMake::ALL.map(RegisterMap::of) {
            let blocks = map.status.iter().chain([&map.settings.read]);
            let mut counts: Vec<u16> = blocks.map(|block| block.count).collect();
            counts.sort_unstable();
            assert!(counts.windows(2).all(|pair| pair[0] < pair[1]), "{}: {counts:?}", map.make);
        }
    }

    #[test]
    fn what_is_written_fits_a_request_and_what_is_expected_fits_its_block() {
        for map in DriveMake::ALL.map(RegisterMap::of) {
            let commands = [
                map.prepare,
                map.start,
                map.home,
                map.stop,
                map.release_stop,
                map.reset,
                map.settings.write,
            ];
            for step in commands.into_iter().flatten() {
                if let Step::Registers { contents, .. } = step {
                    let registers: u16 = contents.iter().copied().map(len).sum();
                    assert!((1..=123).contains(&registers), "{}: {registers}", map.make);
                }
            }
            let expected: u16 = map.settings.expect.iter().copied().map(len).sum();
            assert_eq!(expected, map.settings.read.count, "{}", map.make);
        }
    }
}
