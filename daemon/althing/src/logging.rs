//! The log: for who runs the daemon, on stderr, quiet unless asked.
//!
//! `ALTHING_LOG` speaks the language of `tracing`'s filters (`info`, `agent=debug`) and wins over
//! `-v`; results and mistakes are never logged, they are printed.

use terminal::visible;
use tracing_subscriber::field::MakeExt as _;
use tracing_subscriber::filter::{FilterExt as _, filter_fn};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _, fmt, registry};

/// The variable that says what is logged.
const VARIABLE: &str = "ALTHING_LOG";

/// Begins to log. What cannot be read of the filter is left out, and said so.
pub(crate) fn start(verbose: u8) {
    let asked = std::env::var(VARIABLE).ok().filter(|filter| !filter.trim().is_empty());
    // Who asks for more of Zenoh reads its errors as they are.
    let is_plain = asked.is_none() && verbose < 2;
    let filter = asked.unwrap_or_else(|| level(verbose).to_owned());
    let filter = EnvFilter::builder().parse(&filter).unwrap_or_else(|err| {
        terminal::output::note(&format!("{VARIABLE}={filter} is left out: {err}"));
        EnvFilter::new(level(verbose))
    });
    // What others said stands in the fields; the rest of a line is ours.
    let fields = fmt::format::debug_fn(|writer, field, value| {
        let value = format!("{value:?}");
        match field.name() {
            "message" => write!(writer, "{}", visible::line(&value)),
            // Where a line of the crate `log` came from stands before it already.
            name if name.starts_with("log.") => Ok(()),
            name => write!(writer, "{name}={}", visible::line(&value)),
        }
    });
    let lines =
        fmt::layer()
            .fmt_fields(fields.delimited(" "))
            .with_writer(|| terminal::output::Notes)
            .with_ansi(terminal::output::stderr_is_colored())
            .with_filter(filter.and(substrate_zenoh::without_calls_to_self()).and(filter_fn(
                move |about| !is_plain || !substrate_zenoh::is_error_of_zenoh(about),
            )));
    let plain = is_plain.then(substrate_zenoh::plain_words);
    // A second start, in a test, changes nothing.
    let _ = registry().with(lines).with(plain).with(substrate_zenoh::too_long()).try_init();
}

/// What `-v` means. Zenoh tells much that is of use to nobody who does not work on Zenoh: its sessions,
/// that something came before the name it goes by, where routers still tell each other what is there.
/// Agents say again what nobody has received. Its errors are told by `substrate_zenoh::plain_words`.
fn level(verbose: u8) -> &'static str {
    match verbose {
        0 => "warn,zenoh=error,zenoh::api::session=off",
        1 => "info,zenoh=warn",
        2 => "debug,zenoh=info",
        _ => "trace",
    }
}
