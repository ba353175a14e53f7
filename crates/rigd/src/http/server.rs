//! The listener: limits on the number and the duration of connections, and their end.

use std::{future::poll_fn, net::IpAddr, pin::Pin, sync::Arc, time::Duration};

use axum::{
    Router,
    body::Body,
    http::{HeaderValue, Request, header},
};
use futures_util::TryFutureExt;
use hyper::{body::Incoming, server::conn::http1, service::service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::{
    io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::{AcquireError, OwnedSemaphorePermit, Semaphore},
    task::JoinSet,
    time::{sleep, timeout},
};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use super::{
    guard::Connection,
    problem::{PROBLEM_JSON, Problem},
    room::Room,
    tls::Tls,
};

/// Beyond the ordinary connections, one takes one request, and only a stop is carried out: however many clients
/// there are, stopping stays possible.
const SPARES_MAX: usize = 64;
/// A reserved connection is closed after this time.
const SPARE_TIME: Duration = Duration::from_secs(10);
/// A head fits in one packet, and a handshake of TLS takes two round trips: a slower client is not a browser or a
/// program in order.
const HEAD_TIME: Duration = Duration::from_secs(5);
/// On a spare, where others wait.
const SPARE_HEAD_TIME: Duration = Duration::from_secs(1);
/// Browsers send 1 to 2 kB; a token may have 4 kB.
const HEAD_MAX: usize = 16 << 10;
/// Size of the read buffer; the library needs at least 8 kB.
const BUFFER_MAX: usize = 32 << 10;
/// Lifetime of a connection whose client acknowledges no data.
const UNHEARD_TIME: Duration = Duration::from_secs(20);
/// Longest time, and largest number of bytes, for which the server reads after its last answer.
const LEAVE_TIME: Duration = Duration::from_secs(1);
const LEAVE_MAX: u64 = 4 << 20;
/// Time limit for current requests at the end of the daemon.
const GRACE: Duration = Duration::from_secs(2);
/// Pause after a connection could not be accepted, for example without free file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Serves until `closing`; after that, requests under way have `GRACE` to end.
///
/// With `tls`, nothing is answered to a client that does not shake hands.
pub async fn serve(
    listener: TcpListener,
    tls: Option<Tls>,
    router: Router,
    closing: CancellationToken,
) {
    let ordinary = Arc::new(Semaphore::new(Room::now().connections));
    let spares = Arc::new(Semaphore::new(SPARES_MAX));
    let mut connections = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = closing.cancelled() => break,
        };
        while connections.try_join_next().is_some() {}
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!(%error, "a connection could not be accepted");
                sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let (place, is_spare) = tokio::select! {
            place = first_place(&ordinary, &spares) => place,
            () = closing.cancelled() => break,
        };
        let (router, closing, tls) = (router.clone(), closing.clone(), tls.clone());
        connections.spawn(async move {
            let connection = Connection {
                arrived_at: arrived_at(&stream),
                peer: Some(peer.ip().to_canonical()),
                is_tls: tls.is_some(),
                is_spare,
            };
            watch_over(&stream);
            let conversation = async {
                match tls {
                    Some(tls) => match tls.accept(stream, connection.head_time()).await {
                        Ok(stream) => converse(stream, router, connection, closing).await,
                        Err(error) => tracing::debug!(%error, "no TLS with a client"),
                    },
                    None => converse(stream, router, connection, closing).await,
                }
            };
            if is_spare {
                _ = timeout(SPARE_TIME, conversation).await;
            } else {
                conversation.await;
            }
            drop(place);
        });
    }
    drop(listener);
    // Connections that remain are dropped with the set.
    _ = timeout(GRACE, async { while connections.join_next().await.is_some() {} }).await;
}

/// An ordinary place, or a spare one if that comes free first, and whether it is spare.
async fn first_place(
    ordinary: &Arc<Semaphore>,
    spares: &Arc<Semaphore>,
) -> (Result<OwnedSemaphorePermit, AcquireError>, bool) {
    tokio::select! {
        biased;
        place = Arc::clone(ordinary).acquire_owned() => (place, false),
        place = Arc::clone(spares).acquire_owned() => (place, true),
    }
}

impl Connection {
    /// Time limit of a handshake, and of a head.
    const fn head_time(&self) -> Duration {
        if self.is_spare { SPARE_HEAD_TIME } else { HEAD_TIME }
    }
}

fn arrived_at(stream: &TcpStream) -> Option<IpAddr> {
    stream.local_addr().ok().map(|address| address.ip().to_canonical())
}

/// Makes the system close a connection whose client has vanished or does not read.
fn watch_over(stream: &TcpStream) {
    if let Err(error) = rig_system::network::limit_silence(stream, UNHEARD_TIME) {
        tracing::debug!(%error, "a connection has no limit for vanished clients");
    }
}

/// Answers the requests of one client.
async fn converse(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    router: Router,
    connection: Connection,
    closing: CancellationToken,
) {
    let service = service_fn(move |request: Request<Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(connection);
        let is_last = has_transfer_encoding(&request);
        router.clone().oneshot(request).map_ok(move |mut answer| {
            if is_last {
                answer.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
            }
            answer
        })
    });
    let mut conversation = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(connection.head_time())
        .max_header_size(HEAD_MAX)
        .max_buf_size(BUFFER_MAX)
        .keep_alive(!connection.is_spare)
        .serve_connection(TokioIo::new(stream), service);
    let ended = tokio::select! {
        ended = poll_fn(|cx| conversation.poll_without_shutdown(cx)) => Some(ended),
        () = closing.cancelled() => None,
    };
    let ended = if let Some(ended) = ended {
        ended
    } else {
        Pin::new(&mut conversation).graceful_shutdown();
        poll_fn(|cx| conversation.poll_without_shutdown(cx)).await
    };
    if let Err(error) = &ended {
        tracing::debug!(%error, "a connection has ended");
    }
    if connection.is_spare {
        // Others wait for its place.
        return;
    }
    let left = conversation.into_parts();
    let is_head_late = ended.is_err_and(|error| error.is_timeout()) && !left.read_buf.is_empty();
    take_leave(left.io.into_inner(), is_head_late).await;
}

/// Whether the connection ends with the answer to this request.
///
/// A proxy that goes by `Content-Length` where rigd goes by `Transfer-Encoding` takes the rest of a body for the next
/// request. After a request with both, RFC 9112 (6.1) has the server close the connection. The library takes
/// `Content-Length` out of such a request, so that any with `Transfer-Encoding` may have been one.
fn has_transfer_encoding(request: &Request<Body>) -> bool {
    request.headers().contains_key(header::TRANSFER_ENCODING)
}

/// Closes a connection so that the client can read the last answer, even if it is still sending:
/// what arrives after a socket is closed would make the system take the answer back.
async fn take_leave(mut stream: impl AsyncRead + AsyncWrite + Unpin, is_head_late: bool) {
    let leave = async {
        if is_head_late {
            // The library says nothing to a client that sent a part of a head.
            stream.write_all(head_late().as_bytes()).await?;
        }
        stream.shutdown().await?;
        tokio::io::copy(&mut (&mut stream).take(LEAVE_MAX), &mut tokio::io::sink()).await
    };
    // A client that has closed needs no orderly end.
    _ = timeout(LEAVE_TIME, leave).await;
}

fn head_late() -> String {
    let body = Problem::head_too_slow().to_json();
    format!(
        "HTTP/1.1 408 Request Timeout\r\ncontent-type: {PROBLEM_JSON}\r\nconnection: close\r\n\
         content-length: {}\r\n\r\n{body}",
        body.len()
    )
}

#[cfg(test)]
mod tests {
    use axum::routing::get;
    use tokio::{
        io::{DuplexStream, duplex},
        task::JoinHandle,
        time::Instant,
    };

    use super::*;

    const REQUEST: &[u8] = b"GET / HTTP/1.1\r\nhost: localhost\r\n\r\n";

    /// A connection to a client that sends the bytes written to the stream.
    fn begin(is_spare: bool) -> (DuplexStream, CancellationToken, JoinHandle<()>) {
        let (client, server) = duplex(1 << 10);
        let router = Router::new().route("/", get(async || "answer"));
        let (closing, connection) = (
            CancellationToken::new(),
            Connection { arrived_at: None, peer: None, is_tls: false, is_spare },
        );
        let conversation = tokio::spawn(converse(server, router, connection, closing.clone()));
        (client, closing, conversation)
    }

    async fn rest(mut client: DuplexStream) -> String {
        let mut text = String::new();
        client.read_to_string(&mut text).await.unwrap();
        text
    }

    /// Sends a part of a head and waits for the end.
    #[track_caller]
    fn check(sent: &'static [u8], is_spare: bool) -> impl Future<Output = String> {
        let at = std::panic::Location::caller();
        async move {
            let (began, (mut client, _closing, conversation)) = (Instant::now(), begin(is_spare));
            client.write_all(sent).await.unwrap();
            let text = rest(client).await;
            conversation.await.unwrap();
            let allowed = if is_spare { SPARE_HEAD_TIME } else { HEAD_TIME };
            let took = began.elapsed();
            assert!(took >= allowed && took < allowed + LEAVE_TIME, "{at}: {took:?}");
            text
        }
    }

    #[tokio::test]
    async fn a_client_gets_the_first_place_that_comes_free() {
        let [ordinary, spares] = [1, 1].map(|places| Arc::new(Semaphore::new(places)));
        let (first, is_spare) = first_place(&ordinary, &spares).await;
        assert!(first.is_ok() && !is_spare);
        let (second, is_spare) = first_place(&ordinary, &spares).await;
        assert!(second.is_ok() && is_spare);
        // Both are taken, and the ordinary one comes free.
        let mut waiting = std::pin::pin!(first_place(&ordinary, &spares));
        assert!(futures_util::poll!(&mut waiting).is_pending());
        drop(first);
        assert!(!waiting.await.1);
        drop(second);
    }

    #[tokio::test(start_paused = true)]
    async fn a_head_that_does_not_come_ends_the_connection() {
        assert_eq!(check(b"", false).await, "");
        assert_eq!(check(b"", true).await, "");
        for cut in [1, 10, REQUEST.len() - 1] {
            let answer = check(&REQUEST[..cut], false).await;
            let (head, body) = answer.split_once("\r\n\r\n").unwrap();
            assert!(head.starts_with("HTTP/1.1 408 ") && head.contains(PROBLEM_JSON), "{head}");
            assert!(head.contains(&format!("content-length: {}", body.len())), "{head}");
            let problem: serde_json::Value = serde_json::from_str(body).unwrap();
            assert_eq!(problem["title"], "request timeout");
        }
        // Kept alive after an answer, it ends without another word.
        let answer = check(REQUEST, false).await;
        assert!(answer.ends_with("\r\n\r\nanswer"), "{answer}");
    }

    #[tokio::test(start_paused = true)]
    async fn a_head_that_drips_is_not_waited_for() {
        let began = Instant::now();
        let (client, _closing, conversation) = begin(false);
        let (reading, mut writing) = tokio::io::split(client);
        let drip = tokio::spawn(async move {
            for byte in REQUEST.iter().cycle() {
                if writing.write_all(&[*byte]).await.is_err() {
                    return;
                }
                sleep(Duration::from_millis(900)).await;
            }
        });
        conversation.await.unwrap();
        assert!(began.elapsed() < HEAD_TIME + 2 * LEAVE_TIME, "{:?}", began.elapsed());
        drop(reading);
        drip.await.unwrap();
    }

    /// RFC 9112, 6.1: the chunks count, and what follows them on the connection is not read as a request. Both orders
    /// of the headers, and without the length, whose absence the library does not show.
    #[tokio::test(start_paused = true)]
    async fn nothing_is_answered_after_a_request_with_a_transfer_encoding() {
        let (length, chunked) = ("content-length: 40\r\n", "transfer-encoding: chunked\r\n");
        for framing in
            [format!("{length}{chunked}"), format!("{chunked}{length}"), chunked.to_owned()]
        {
            let (mut client, _closing, conversation) = begin(false);
            let smuggled = std::str::from_utf8(REQUEST).unwrap();
            let sent =
                format!("GET / HTTP/1.1\r\nhost: localhost\r\n{framing}\r\n0\r\n\r\n{smuggled}");
            client.write_all(sent.as_bytes()).await.unwrap();
            let text = rest(client).await;
            conversation.await.unwrap();
            assert_eq!(text.matches("HTTP/1.1 ").count(), 1, "{framing}: {text}");
            assert!(text.contains("connection: close\r\n"), "{framing}: {text}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn closing_ends_what_is_idle_at_once() {
        let (mut client, closing, conversation) = begin(false);
        client.write_all(REQUEST).await.unwrap();
        let mut first = [0; 12];
        client.read_exact(&mut first).await.unwrap();
        let began = Instant::now();
        closing.cancel();
        assert!(rest(client).await.ends_with("answer"));
        conversation.await.unwrap();
        assert_eq!(began.elapsed(), Duration::ZERO);
    }
}
