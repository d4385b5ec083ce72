//! Location of a mistake in the files of an ecosystem.

use pddl::Span;

/// The place where a mistake is written.
#[derive(Clone, Debug)]
pub(crate) enum MistakeLocation {
    /// A span in the text of the map.
    Map(Span),
    /// The path of a key in the ecosystem file, such as `agent.3.config.start`. If the file has no
    /// such key, the place is that of the nearest table or entry around it.
    Key(String),
}
