//! Spans for a collector of `OpenTelemetry`, with the feature `otel`; without it, nothing.

#[cfg(feature = "otel")]
mod export;

#[cfg(feature = "otel")]
pub(crate) use export::{Exported, adopt, start};
#[cfg(not(feature = "otel"))]
pub(crate) use nothing::{Exported, adopt, start};

/// What a program without the feature does.
#[cfg(not(feature = "otel"))]
mod nothing {
    use std::convert::Infallible;

    use axum::http::HeaderMap;
    use tracing::Span;
    use tracing_subscriber::layer::Identity;

    /// No program has one.
    #[derive(Debug)]
    pub(crate) enum Exported {}

    impl Exported {
        pub(crate) const fn layer(&self) -> Identity {
            match *self {}
        }
    }

    #[expect(clippy::unnecessary_wraps, reason = "with the feature it can fail")]
    pub(crate) const fn start() -> Result<Option<Exported>, Infallible> {
        Ok(None)
    }

    pub(crate) const fn adopt(_: &Span, _: &HeaderMap) {}
}
