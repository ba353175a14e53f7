//! Ports on pseudo-terminals, each with a link that stays.

use std::{
    io,
    path::{Path, PathBuf},
};

use tokio::sync::Notify;

use super::{Role, ServeError, Server, connect, pty::Pty};
use crate::SimHandle;

impl Server {
    /// Serves a port on a new pseudo-terminal, to which `link` points, if given. Returns the path
    /// of the terminal. When the device hangs up, that path goes away and the link points to a new
    /// one, as when an adapter is unplugged and plugged in again.
    ///
    /// # Errors
    /// [`ServeError::Pty`], [`ServeError::Link`].
    pub fn open_pty(&mut self, role: Role, link: Option<&Path>) -> Result<PathBuf, ServeError> {
        let (pty, link) = plug_in(link)?;
        let path = pty.path().to_owned();
        let (handle, free) = (self.handle.clone(), self.free.clone());
        self.tasks.spawn(async move { serve_ptys(&handle, role, pty, link, &free).await });
        Ok(path)
    }

    /// Waits until a pseudo-terminal is ready for its next client: the last one has closed and the
    /// settings of the terminal were restored, or the terminal was plugged in again. Events since
    /// the last call count once.
    pub async fn port_is_free(&self) {
        self.free.notified().await;
    }
}

/// A symbolic link that is removed when it is dropped.
#[derive(Debug)]
struct Link(PathBuf);

impl Link {
    fn make(target: &Path, link: &Path) -> Result<Self, ServeError> {
        let fail = |source| ServeError::Link { link: link.to_owned(), source };
        // A link that an earlier run left behind is replaced; anything else is not.
        if link.symlink_metadata().is_ok_and(|metadata| metadata.is_symlink()) {
            std::fs::remove_file(link).map_err(fail)?;
        }
        std::os::unix::fs::symlink(target, link).map_err(fail)?;
        Ok(Self(link.to_owned()))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // The receiver may have been dropped already.
        _ = std::fs::remove_file(&self.0);
    }
}

/// A new pseudo-terminal with the link that points to it.
fn plug_in(link: Option<&Path>) -> Result<(Pty, Option<Link>), ServeError> {
    let pty = Pty::open().map_err(ServeError::Pty)?;
    let link = link.map(|link| Link::make(pty.path(), link)).transpose()?;
    Ok((pty, link))
}

/// Serves one terminal after the other: a new one each time that the device hangs up.
async fn serve_ptys(
    handle: &SimHandle,
    role: Role,
    mut pty: Pty,
    mut link: Option<Link>,
    free: &Notify,
) {
    loop {
        let served = serve_pty(handle, role, &mut pty, free).await;
        if let Err(error) = served {
            tracing::error!(path = %pty.path().display(), %error, "clients cannot be watched");
            return;
        }
        let place = link.take().map(|link| link.0.clone());
        let gone = pty.path().to_owned();
        drop(pty);
        (pty, link) = match plug_in(place.as_deref()) {
            Ok(plugged) => plugged,
            Err(error) => {
                tracing::error!(%error, "the terminal did not come back");
                return;
            }
        };
        tracing::info!(gone = %gone.display(), path = %pty.path().display(), "plugged in again");
        free.notify_one();
    }
}

/// Serves a terminal until the device hangs up. It does not notice clients: like a device on a
/// cable it sees only bytes.
async fn serve_pty(handle: &SimHandle, role: Role, pty: &mut Pty, free: &Notify) -> io::Result<()> {
    let (terminal, line, clients) = pty.parts();
    let mut serving = std::pin::pin!(handle.serve(connect(handle, role), terminal));
    loop {
        tokio::select! {
            biased;
            () = &mut serving => return Ok(()),
            gone = clients.gone() => {
                gone?;
                line.refresh().await?;
                free.notify_one();
            }
        }
    }
}
