//! Opens an instrument on USB: the device file of the driver `usbtmc`, or a socket that stands for one.

mod kernel;
mod socket;

use std::{
    fs, io,
    os::unix::fs::FileTypeExt,
    path::Path,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use rig_usbtmc::{gives_status_byte, set_timeout};
use rustix::fs::{FlockOperation, flock};

use crate::{
    OpenError,
    attached::{is_of_usbtmc, others},
    device::what_it_is,
    messages::MessageLink,
};
use kernel::KernelDevice;
use socket::SocketDevice;

/// Time limit of a transfer. A port gives a message up after a second.
const TRANSFER_WITHIN: Duration = Duration::from_millis(900);

/// Wait for a lock that no other program is seen to hold: it may be of this one, since the owner of a port that was
/// closed ends after its last request, for which the driver waits for 5 s.
const LOCKED_WITHIN: Duration = Duration::from_millis(5500);

/// Time between two attempts to lock.
const LOCK_EVERY: Duration = Duration::from_millis(20);

/// What the file must be.
const WANTED: &str = "an instrument on USB";

/// Opens an instrument. Blocks.
pub(crate) fn open(port: &Arc<str>, path: &str) -> Result<MessageLink, OpenError> {
    // The device file behind any symbolic links.
    let device = fs::canonicalize(path).unwrap_or_else(|_| path.into());
    let fail = |source| explain(port.clone(), source);
    let is_socket = fs::metadata(&device).is_ok_and(|file| file.file_type().is_socket());
    if is_socket {
        let socket = SocketDevice::connect(&device, TRANSFER_WITHIN).map_err(fail)?;
        return MessageLink::start(socket).map_err(fail);
    }
    let is_of_another_driver = device.exists() && !is_of_usbtmc(&device);
    let other = || is_of_another_driver.then_some("a device of another driver");
    // To open it may already do something to it.
    if let Some(what) = what_it_is(&device).or_else(other) {
        return Err(OpenError::NotAPort { port: port.clone(), what, wanted: WANTED });
    }
    let file = fs::File::options().read(true).write(true).open(&device).map_err(fail)?;
    set_timeout(&file, TRANSFER_WITHIN).map_err(fail)?;
    // The driver lets several programs in. The lock keeps out those that ask for it, such as another rigd.
    if !lock(&file, &device, LOCKED_WITHIN).map_err(fail)? {
        return Err(OpenError::Busy { port: port.clone(), holders: others(&device) });
    }
    // Without it, a wait for an answer would have to be a read that nothing can end.
    if !gives_status_byte(&file).map_err(fail)? {
        return Err(OpenError::NoStatusByte { port: port.clone() });
    }
    MessageLink::start(KernelDevice(file)).map_err(fail)
}

/// Locks a file for this program, if no other one has.
fn lock(file: &fs::File, device: &Path, within: Duration) -> io::Result<bool> {
    let begun = Instant::now();
    loop {
        match flock(file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => return Ok(true),
            Err(rustix::io::Errno::WOULDBLOCK) => {
                if within <= begun.elapsed() || !others(device).is_empty() {
                    return Ok(false);
                }
                thread::sleep(LOCK_EVERY);
            }
            Err(error) => return Err(error.into()),
        }
    }
}

fn explain(port: Arc<str>, source: io::Error) -> OpenError {
    use io::ErrorKind::{ConnectionRefused, NotFound, PermissionDenied};
    let is_gone = source.raw_os_error() == Some(rustix::io::Errno::NODEV.raw_os_error());
    match source.kind() {
        PermissionDenied => OpenError::Permission { port },
        // A socket that nobody serves is as good as none.
        NotFound | ConnectionRefused => OpenError::Absent { port },
        _ if is_gone => OpenError::Absent { port },
        _ => OpenError::Io { port, source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_locked_once_and_is_free_when_it_is_closed() {
        let path = std::env::temp_dir().join(format!("rig-link-lock-{}", std::process::id()));
        let open = || fs::File::options().create(true).append(true).open(&path).unwrap();
        let (first, second) = (open(), open());
        assert!(lock(&first, &path, Duration::ZERO).unwrap());
        assert!(!lock(&second, &path, Duration::ZERO).unwrap());
        drop(first);
        assert!(lock(&second, &path, LOCKED_WITHIN).unwrap());
        fs::remove_file(&path).unwrap();
    }

    #[test]
    fn errors_of_the_system_are_told_by_their_reason() {
        use rustix::io::Errno;
        let rows = [
            (Errno::ACCESS, "usbtmc0: permission denied"),
            (Errno::NOENT, "usbtmc0: no such port"),
            // The file of an instrument that has just been unplugged.
            (Errno::NODEV, "usbtmc0: no such port"),
            (Errno::TIMEDOUT, "usbtmc0: cannot be opened"),
        ];
        for (error, expected) in rows {
            let source = io::Error::from(error);
            assert_eq!(explain("usbtmc0".into(), source).to_string(), expected);
        }
    }
}
