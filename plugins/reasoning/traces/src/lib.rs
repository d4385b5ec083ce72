//! Traces: what happens to each goal, for a collector of OpenTelemetry.
//!
//! The agent overhears the messages of the ecosystem and sends none. `tracer` turns them into
//! spans, `conversation_trace` those of one goal; `export_queue` keeps spans until the collector
//! has taken them, `otlp` encodes them, `http` hands them over. A collector that is away costs a
//! bounded queue, and nothing else: no agent waits for this one.

mod call_answers;
mod config;
mod conversation_trace;
mod export_queue;
mod http;
mod otlp;
mod outcomes;
mod recent;
mod span;
#[cfg(test)]
mod tests;
mod tracer;

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, LaunchableAgent, OverheardBatch, PluginEntry,
    WorkHandle,
};
use hyper::body::Bytes;

use crate::config::Collector;
use crate::export_queue::ExportQueue;
use crate::http::PostError;
use crate::span::{Attribute, AttributeValue, UnixNanos};
use crate::tracer::Tracer;

/// Maximum number of overheard messages that wait; more are lost and counted.
const WAITING_MAX: usize = 8_192;

/// How long spans wait for others, to be sent in one request.
const FLUSHED_EVERY: Duration = Duration::from_secs(2);

/// How often losses are logged.
const LOGGED_EVERY: Duration = Duration::from_secs(60);

/// The entry of the plugin in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "traces",
    about: "hands what happens to each goal to a collector of OpenTelemetry",
    drivers: &[],
    has_replicas: true,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let collector = config::collector(&blueprint)?;
    Ok(Box::new(TraceExporter {
        collector,
        tracer: Tracer::new(""),
        queue: ExportQueue::default(),
        request: None,
        is_leading: false,
        is_pausing: false,
        missed: 0,
    }))
}

/// The agent. Of several replicas, only the leader sends spans; all know the conversations.
struct TraceExporter {
    collector: Collector,
    tracer: Tracer,
    queue: ExportQueue,
    /// The request under way.
    request: Option<WorkHandle>,
    is_leading: bool,
    /// Whether the collector was away, and the pause before the next request is not over.
    is_pausing: bool,
    /// Messages that were lost or could not be read, since they were logged last.
    missed: u64,
}

impl Agent for TraceExporter {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.tracer = Tracer::new(ctx.ecosystem().as_str());
        if let Err(error) = ctx.overhear(WAITING_MAX, Self::heard) {
            tracing::warn!(%error, "no traces: the messages of the ecosystem cannot be heard");
        }
        ctx.after(FLUSHED_EVERY, Self::flush);
        ctx.after(LOGGED_EVERY, Self::log_losses);
    }

    fn leadership_changed(&mut self, is_leading: bool, _ctx: &mut Context<Self>) {
        self.is_leading = is_leading;
    }

    fn wants_presence(&self) -> bool {
        false
    }

    fn drain(&mut self, ctx: &mut Context<Self>) -> bool {
        let ended = self.tracer.abandon(now(ctx));
        if self.is_leading {
            self.queue.add(ended);
        }
        self.send(ctx);
        // A collector that is away is not waited for.
        self.queue.is_empty() || self.queue.is_failing()
    }
}

impl TraceExporter {
    fn heard(&mut self, batch: OverheardBatch, ctx: &mut Context<Self>) {
        let now = now(ctx);
        self.missed += batch.lost + batch.unreadable;
        let messages = batch.messages.iter().map(|heard| &heard.message);
        let spans: Vec<_> = messages.flat_map(|message| self.tracer.hear(message, now)).collect();
        if self.is_leading {
            self.queue.add(spans);
        }
        if self.queue.has_batch() {
            self.send(ctx);
        }
    }

    fn flush(&mut self, ctx: &mut Context<Self>) {
        self.send(ctx);
        ctx.after(FLUSHED_EVERY, Self::flush);
    }

    /// Sends the next batch, unless a request is under way, or the collector was away just now.
    fn send(&mut self, ctx: &mut Context<Self>) {
        if self.is_pausing || self.request.is_some() {
            return;
        }
        let Some(batch) = self.queue.take() else { return };
        let body = otlp::request(&self.resource(ctx), &batch).to_string();
        let collector = self.collector.clone();
        let posted = async move { http::post(&collector, Bytes::from(body)).await };
        self.request = Some(ctx.run(posted, Self::posted));
    }

    fn posted(&mut self, answer: Result<Option<String>, PostError>, ctx: &mut Context<Self>) {
        self.request = None;
        match answer {
            Ok(warning) => {
                if let Some(warning) = warning {
                    tracing::warn!(warning, "the collector has not taken all spans");
                }
                self.queue.taken();
                // Further spans wait for the next flush, unless they are many.
                if self.queue.has_batch() {
                    self.send(ctx);
                }
            }
            Err(PostError::Later { why, pause }) => {
                if !self.queue.is_failing() {
                    tracing::warn!("failed to {why}; spans wait until the collector is back");
                }
                let pause = self.queue.failed(pause);
                self.is_pausing = true;
                ctx.after(pause, |exporter: &mut Self, ctx| {
                    exporter.is_pausing = false;
                    exporter.send(ctx);
                });
            }
            Err(PostError::Never(why)) => {
                tracing::warn!("failed to {why}; its spans are dropped");
                self.queue.refused();
            }
        }
    }

    fn log_losses(&mut self, ctx: &mut Context<Self>) {
        let (dropped, missed) = (self.queue.take_dropped(), std::mem::take(&mut self.missed));
        if dropped + missed > 0 {
            tracing::warn!(dropped, missed, "spans were dropped, and messages missed");
        }
        ctx.after(LOGGED_EVERY, Self::log_losses);
    }

    /// Returns the attributes of the process that sends the spans.
    fn resource(&self, ctx: &Context<Self>) -> Vec<Attribute> {
        let (ecosystem, daemon) = (ctx.ecosystem().as_str(), ctx.daemon().as_str());
        let text = |text: &str| AttributeValue::from(text);
        vec![
            ("service.name", text("althing")),
            ("service.namespace", text(ecosystem)),
            ("service.instance.id", text(&format!("{ecosystem}/{daemon}/{}", ctx.id()))),
            ("service.version", text(env!("CARGO_PKG_VERSION"))),
            ("althing.ecosystem", text(ecosystem)),
            ("althing.daemon", text(daemon)),
        ]
    }
}

fn now(ctx: &Context<TraceExporter>) -> UnixNanos {
    since_1970(ctx.wall_clock())
}

fn since_1970(time: SystemTime) -> UnixNanos {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    UnixNanos(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}
