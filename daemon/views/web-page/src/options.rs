//! The settings of a server of pages.

use std::collections::BTreeMap;
use std::path::PathBuf;

use phrases::{Language, OwnWords};

/// The default number of connections at a time: five hundred pages, or a hundred with all that a
/// browser opens beside their events.
const CONNECTIONS: usize = 512;

/// The default number of connections of one address: a floor of people behind one gateway.
const CONNECTIONS_PER_ADDRESS: usize = 192;

/// The settings of a server of pages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageOptions {
    /// Names and addresses by which browsers may call this server, beside `localhost` and the
    /// address to which they connect: `pi`, `pi.example.org`.
    pub names: Vec<String>,
    /// Maximum number of connections at a time.
    pub connections: usize,
    /// Maximum number of connections of one address.
    pub connections_per_address: usize,
    /// A folder with the files that run in the browser, in place of those in this program; they
    /// are read anew for each request. For those that change the pages.
    pub assets: Option<PathBuf>,
    /// The words that the ecosystem adds to those of goals and facts, by language.
    pub words: BTreeMap<Language, OwnWords>,
}

impl Default for PageOptions {
    fn default() -> PageOptions {
        PageOptions {
            names: Vec::new(),
            connections: CONNECTIONS,
            connections_per_address: CONNECTIONS_PER_ADDRESS,
            assets: None,
            words: BTreeMap::new(),
        }
    }
}
