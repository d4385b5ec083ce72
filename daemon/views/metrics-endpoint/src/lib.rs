//! Answers HTTP requests for the metrics of a process, in the text formats of Prometheus and
//! OpenMetrics, and for its health.
//!
//! - [`MetricFamily`] is one metric with its samples; [`exposition`] writes families as text.
//! - [`MetricsSource`] is what is asked at each request: it returns families, and a [`Health`].
//! - [`MetricsListener`] accepts connections, with or without TLS, and answers `/metrics` and
//!   `/healthz`. Everything that a client can take is bounded: connections, headers, time.
//!
//! The crate knows nothing of agents: what is measured is decided by its callers.

mod connection;
pub mod exposition;
mod family;
mod listener;
mod responses;
mod tls;

pub use exposition::ExpositionFormat;
pub use family::{MetricFamily, MetricKind, Sample};
pub use listener::{ListenError, MetricsListener};
pub use responses::{Health, MetricsSource};
pub use tls::{TlsError, TlsFiles, TlsServer};
