//! How much is taken from how many. What exceeds is refused with a reason, never cut off silently.
//!
//! A building of the design has a hundred agents with ten actions and some tens of facts each;
//! every limit leaves an order of magnitude above it, and bounds what one agent gone wild can
//! take from the others.

/// Agents at a time. A key-expression tree of a thousand tokens is what one router still lists
/// in one answer.
pub const AGENTS_MAX: usize = 1_024;

/// Actions of one agent. The composite domain of a full house is then at most what a planner
/// grounds in seconds.
pub const ACTIONS_PER_AGENT_MAX: usize = 128;

/// Types, predicates, functions and axioms of one agent, together.
pub const DECLARATIONS_PER_AGENT_MAX: usize = 512;

/// Objects of one agent: a camera that names everything it sees stays below.
pub const OBJECTS_PER_AGENT_MAX: usize = 1_024;

/// Facts one owner may claim at a time; a distance between each two of sixty rooms stays below.
pub const FACTS_PER_OWNER_MAX: usize = 4_096;

/// Agents that left and left facts behind that nobody knows: all that may be here.
pub const DEPARTED_MAX: usize = AGENTS_MAX;

/// Predicates that are remembered as ones whose facts may be unknown. A building has some tens.
pub const UNKNOWABLE_MAX: usize = 1_024;

/// Facts that requests may add to the map's word, with those the map has.
pub const MAP_FACTS_MAX: usize = 65_536;

/// Owners of facts that are no agents with a model: people's keyboards, tools, other ecosystems.
pub const OWNERS_MAX: usize = 2 * AGENTS_MAX;

/// Agents that left and whose last incarnation is remembered, so that their late reports are
/// known as such. The ones that started longest ago are forgotten first.
pub const FORMER_MAX: usize = 4 * AGENTS_MAX;

/// Actions taken off by request: all actions of thirty agents, one by one.
pub const WITHHELD_MAX: usize = 4_096;

/// Action schemas remembered after the last agent that offered them left. A building has some
/// tens of them; they are for explanations, and travel with every snapshot that lacks them.
pub const REMEMBERED_MAX: usize = 64;

const _: () = assert!(FORMER_MAX >= AGENTS_MAX, "all agents may leave at once");
const _: () = assert!(OBJECTS_PER_AGENT_MAX <= FACTS_PER_OWNER_MAX, "each object has a place");
