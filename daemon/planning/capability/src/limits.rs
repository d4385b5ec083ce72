//! Limits on the inputs of each agent. An input that exceeds a limit is refused with a reason, never
//! truncated.
//!
//! A building is expected to have a hundred agents, each with ten actions and some tens of facts. Each
//! limit is an order of magnitude above that. It restricts how much of the memory and time one faulty
//! agent can take from the others.

/// Maximum number of agents at a time. A router can still list a thousand liveliness tokens in one
/// answer.
pub const AGENTS_MAX: usize = 1_024;

/// Maximum number of actions of one agent. With this limit, a planner can ground the composite domain of
/// a full building in seconds.
pub const ACTIONS_PER_AGENT_MAX: usize = 128;

/// Maximum number of types, predicates, functions and axioms of one agent, in total.
pub const DECLARATIONS_PER_AGENT_MAX: usize = 512;

/// Maximum number of objects of one agent: enough for a camera that names everything it sees.
pub const OBJECTS_PER_AGENT_MAX: usize = 1_024;

/// Maximum number of facts that one owner may claim at a time: enough for the distances between all pairs
/// of sixty rooms.
pub const FACTS_PER_OWNER_MAX: usize = 4_096;

/// Maximum number of agents that have left and for which facts are kept as unknown: as many as may be
/// present.
pub const DEPARTED_MAX: usize = AGENTS_MAX;

/// Maximum number of predicates that are recorded as having facts that may be unknown. A building has
/// some tens.
pub const UNKNOWABLE_MAX: usize = 1_024;

/// Maximum number of facts of the map, including those that requests add to it.
pub const MAP_FACTS_MAX: usize = 65_536;

/// Maximum number of owners of facts at a time. An owner need not be an agent with a model: users, tools
/// and other ecosystems own facts too.
pub const OWNERS_MAX: usize = 2 * AGENTS_MAX;

/// Maximum number of agents that have left and for which the last incarnation is remembered, so that late
/// messages of this incarnation are recognised. The incarnations that started longest ago are dropped
/// first.
pub const FORMER_MAX: usize = 4 * AGENTS_MAX;

/// Maximum number of actions that requests withhold: enough for all actions of thirty agents, one by one.
pub const WITHHELD_MAX: usize = 4_096;

/// Maximum number of action schemas that are kept after the last agent that offered them has left. A
/// building has some tens of them. They are used for explanations, and every snapshot contains those that
/// no agent offers.
pub const REMEMBERED_MAX: usize = 64;

const _: () = assert!(FORMER_MAX >= AGENTS_MAX, "all agents may leave at once");
const _: () = assert!(OBJECTS_PER_AGENT_MAX <= FACTS_PER_OWNER_MAX, "each object has a place");
