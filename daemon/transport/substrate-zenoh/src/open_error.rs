//! Errors that occur when a session is opened.

use zenoh::key_expr::KeyExpr;

use crate::endpoint::EndpointError;
use crate::listen_problem;

/// Reason why a session could not be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// An endpoint may not be used, for the reason in this error.
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    /// A client has no endpoint to connect to.
    #[error("connect as a client: name the endpoint of a daemon, like `tls/office-pi.local:7447`")]
    NowhereToConnect,
    /// The `[zenoh]` table chooses a mode.
    #[error(
        "read `[zenoh]`: leave out `mode`; a daemon is a router, because Zenoh's peers do not \
         relay messages, and a command line is a client"
    )]
    ModeInSettings,
    /// The `[zenoh]` settings are not a table.
    #[error("read `[zenoh]`: write a table of Zenoh's settings, like `connect.endpoints = [...]`")]
    NotATable,
    /// The settings ask for scouting without security: other daemons could be found, but no link
    /// with them is allowed.
    #[error(
        "scout (`scouting = true` in `[zenoh]`): plain text stays on this machine, so no \
         daemon elsewhere could be reached; secure the ecosystem (`althing help cert`)"
    )]
    ScoutingUnsecured,
    /// Zenoh rejects a setting.
    #[error("read `{at}` of `[zenoh]`; Zenoh's DEFAULT_CONFIG.json5 lists the settings")]
    Settings {
        /// Path of the setting that Zenoh rejects.
        at: String,
        /// Error that Zenoh returned.
        source: zenoh::Error,
    },
    /// The daemon cannot listen on an endpoint, because its port is taken or its address is not one
    /// of this machine.
    #[error("{obstacle}")]
    Listen {
        /// The endpoint, the reason why the daemon cannot listen on it, and the remedy.
        obstacle: String,
        /// Error that Zenoh returned.
        source: zenoh::Error,
    },
    /// Zenoh could not open the session.
    #[error("{}", unopened(listen, connect))]
    Session {
        /// Endpoints on which the session was to listen.
        listen: Vec<String>,
        /// Endpoints to which the session was to connect.
        connect: Vec<String>,
        /// Error that Zenoh returned.
        source: zenoh::Error,
    },
    /// The session is open, but a declaration of the kind that every daemon makes failed.
    #[error("declare {what}")]
    Declare {
        /// The declaration that failed.
        what: String,
        /// Error that Zenoh returned.
        source: zenoh::Error,
    },
}

/// Returns the error for a session that did not open: an endpoint that cannot be listened on, or
/// Zenoh's error.
pub(crate) fn not_opened(
    listen: Vec<String>,
    connect: Vec<String>,
    source: zenoh::Error,
) -> OpenError {
    match listen_problem::obstacle(&listen) {
        Some(obstacle) => OpenError::Listen { obstacle, source },
        None => OpenError::Session { listen, connect, source },
    }
}

/// Returns the error for a declaration that failed: `what` is its kind.
pub(crate) fn undeclared(what: &str, key_expr: &KeyExpr, source: zenoh::Error) -> OpenError {
    OpenError::Declare { what: format!("{what} `{key_expr}`"), source }
}

/// Describes why a session did not open. If there are no endpoints to listen on, the reason is that
/// no connection was made; otherwise either kind of endpoint may be the reason.
fn unopened(listen: &[String], connect: &[String]) -> String {
    if let ([], [_, ..]) = (listen, connect) {
        let places = connect.join("`, `");
        return format!("reach a daemon at `{places}`: no daemon answers there, or it declines");
    }
    let place = |what: &str, endpoints: &[String]| match endpoints {
        [] => String::new(),
        some => format!(" {what} `{}`", some.join("`, `")),
    };
    let (listening, connecting) = (place("listening on", listen), place("connecting to", connect));
    format!("open a Zenoh session{listening}{connecting}")
}
