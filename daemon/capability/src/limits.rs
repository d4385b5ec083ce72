//! Limits on the inputs of each agent. What exceeds a limit is refused with a reason, never truncated.
//!
//! A building is expected to have a hundred agents, each with ten actions and some tens of facts. Each
//! limit is an order of magnitude above that, and bounds what one faulty agent can take from the
//! others.

/// Agents at a time. A router can still list a thousand liveliness tokens in one answer.
pub const AGENTS_MAX: usize = 1_024;

/// Actions of one agent. A planner can then ground the composite domain of a full building in seconds.
pub const ACTIONS_PER_AGENT_MAX: usize = 128;

/// Types, predicates, functions and axioms of one agent, in total.
pub const DECLARATIONS_PER_AGENT_MAX: usize = 512;

/// Objects of one agent: enough for a camera that names everything it sees.
pub const OBJECTS_PER_AGENT_MAX: usize = 1_024;

/// Facts that one owner may claim at a time: enough for the distances between all pairs of sixty rooms.
pub const FACTS_PER_OWNER_MAX: usize = 4_096;

/// Agents that have left and left unknown facts behind: as many as may be present.
pub const DEPARTED_MAX: usize = AGENTS_MAX;

/// Predicates that are kept as having facts that may be unknown. A building has some tens.
pub const UNKNOWABLE_MAX: usize = 1_024;

/// Facts of the map, including those that requests add to it.
pub const MAP_FACTS_MAX: usize = 65_536;

/// Owners of facts that may exist at a time. Owners need not be agents with a model: users, tools and
/// other ecosystems own facts too.
pub const OWNERS_MAX: usize = 2 * AGENTS_MAX;

/// Agents that have left and have their last incarnation kept, so that late messages of it are
/// recognised. The incarnations that started longest ago are dropped first.
pub const FORMER_MAX: usize = 4 * AGENTS_MAX;

/// Actions withheld by request: enough for all actions of thirty agents, one by one.
pub const WITHHELD_MAX: usize = 4_096;

/// Action schemas kept after the last agent that offered them has left. A building has some tens of
/// them. They are used for explanations, and sent with every snapshot in which no agent offers them.
pub const REMEMBERED_MAX: usize = 64;

const _: () = assert!(FORMER_MAX >= AGENTS_MAX, "all agents may leave at once");
const _: () = assert!(OBJECTS_PER_AGENT_MAX <= FACTS_PER_OWNER_MAX, "each object has a place");
