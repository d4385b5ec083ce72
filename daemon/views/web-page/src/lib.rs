//! Serves the pages of an ecosystem to browsers: what is to be seen of it, as events over one
//! connection per page, and what people ask for.
//!
//! - [`PageServer`] listens, with or without TLS ([`PageTls`]), and answers requests within bounds
//!   of time, length and number.
//! - [`PageHost`] is the daemon behind it: returns the view, and carries out each [`PageAct`].
//! - `accounts` knows the people; each act is held against the rights of the person.
//!
//! What runs in the browser is in `assets`. How the ecosystem is observed, and how an act becomes a
//! message, is the host's business.

mod act_limits;
mod acts;
mod answer;
mod api;
mod assets;
mod body;
mod caller;
mod caller_key;
mod connection;
mod cookies;
mod deadline_stream;
mod event_stream;
mod host;
mod moments;
mod notifications;
mod options;
mod origin;
mod png;
mod query;
mod routes;
mod row_set;
mod server;
mod server_state;
mod signing;
mod tls;
mod topic_name;
mod topic_rows;
mod topic_store;
mod topic_task;

pub use host::{
    ActOutcome, BoxFuture, GoalMode, HistoryProblem, PageAct, PageHost, PageMessage, PagePicture,
    PageSetup, PushAnswer, PushAsk, SetupAction, SetupObject, SetupParameter, SetupPredicate,
    SetupType,
};
pub use options::PageOptions;
pub use server::{PageListenError, PageServer};
pub use tls::{PageTls, PageTlsError, PageTlsFiles, certificate_end};
