//! Times one part of rigd on the numbers and ports that another program also gets: `speed fit`,
//! `speed bus`, `speed analyzer`. `fit.sh` and `transaction.sh` call it.
#![expect(clippy::print_stdout, reason = "the times are the output of this program")]

mod analyzer;
mod bus;
mod fit;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["fit", file, rounds] => fit::time(file, rounds.parse()?),
        ["bus", framing, address, count, pause_us] => {
            bus::time(framing, address, count.parse()?, pause_us.parse()?)
        }
        ["analyzer", path, count] => analyzer::time(path, count.parse()?),
        _ => Err("usage: speed fit FILE ROUNDS | bus rtu|tcp ADDRESS COUNT PAUSE_US | \
                  analyzer PATH COUNT"
            .into()),
    }
}
