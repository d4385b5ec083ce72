//! The log: messages for the operator of the daemon, on stderr, few by default.
//!
//! The variable `ALTHING_LOG` contains a filter in the syntax of `tracing`, such as `info` or
//! `agent=debug`; it overrides `-v`. Results and the user's mistakes are never logged; they are
//! printed.

use terminal::visible;
use tracing_subscriber::field::MakeExt as _;
use tracing_subscriber::filter::{FilterExt as _, filter_fn};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _, fmt, registry};

/// Name of the environment variable that contains the filter of the log.
const VARIABLE: &str = "ALTHING_LOG";

/// Starts logging. Ignores a filter that cannot be parsed, and tells the user that.
pub(crate) fn start(verbose: u8) {
    let asked = std::env::var(VARIABLE).ok().filter(|filter| !filter.trim().is_empty());
    // With an explicit filter or `-vv`, Zenoh's errors are logged unchanged.
    let is_plain = asked.is_none() && verbose < 2;
    let filter = asked.unwrap_or_else(|| level(verbose).to_owned());
    let filter = EnvFilter::builder().parse(&filter).unwrap_or_else(|err| {
        terminal::output::print_note(&format!("{VARIABLE}={filter} is left out: {err}"));
        EnvFilter::new(level(verbose))
    });
    // Fields may contain text from outside, so their control characters are made visible.
    let fields = fmt::format::debug_fn(|writer, field, value| {
        let value = format!("{value:?}");
        match field.name() {
            "message" => write!(writer, "{}", visible::line(&value)),
            // The origin of a record of the crate `log` is printed before the message already.
            name if name.starts_with("log.") => Ok(()),
            name => write!(writer, "{name}={}", visible::line(&value)),
        }
    });
    let lines =
        fmt::layer()
            .fmt_fields(fields.delimited(" "))
            .with_writer(|| terminal::output::NoteStream)
            .with_ansi(terminal::output::stderr_is_colored())
            .with_filter(filter.and(substrate_zenoh::self_link_filter()).and(filter_fn(
                move |about| !is_plain || !substrate_zenoh::is_error_of_zenoh(about),
            )));
    let plain = is_plain.then(substrate_zenoh::zenoh_error_layer);
    // A second call, as in tests, has no effect.
    let _ = registry().with(lines).with(plain).with(substrate_zenoh::oversize_layer()).try_init();
}

/// Returns the filter of the log for the number of `-v` on the command line. Zenoh logs much that
/// only its developers need: its sessions, messages that arrive before the declaration of their
/// key, and exchanges between routers. The operator needs none of these records, because agents
/// resend lost messages; they are logged only with more `-v`. Zenoh's errors are logged in plainer
/// words by [`substrate_zenoh::zenoh_error_layer`].
fn level(verbose: u8) -> &'static str {
    match verbose {
        0 => "warn,zenoh=error,zenoh::api::session=off",
        1 => "info,zenoh=warn",
        2 => "debug,zenoh=info",
        _ => "trace",
    }
}
