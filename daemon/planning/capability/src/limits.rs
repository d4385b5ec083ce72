//! Limits on the inputs of each agent. An input that exceeds a limit is refused with a reason, and
//! never truncated.
//!
//! A building is expected to have a hundred agents, each with ten actions and some tens of facts.
//! Each limit is ten times that or more. The limits bound the memory and time that one faulty agent
//! can consume.

/// Maximum number of agents at a time; the model of a further agent is declined. One answer of a
/// Zenoh router can list this many liveliness tokens.
pub const AGENTS_MAX: usize = 1_024;

/// Maximum number of actions of one agent; a model with more is declined. With this limit, a
/// planner can ground the composite domain of a full building in seconds.
pub const ACTIONS_PER_AGENT_MAX: usize = 128;

/// Maximum number of types, predicates, functions and axioms of one agent, in total. A model with
/// more is declined.
pub const DECLARATIONS_PER_AGENT_MAX: usize = 512;

/// Maximum number of objects of one agent: enough for a camera with an object for each thing in its
/// view. A model with more is declined.
pub const OBJECTS_PER_AGENT_MAX: usize = 1_024;

/// Maximum number of facts that one owner may claim at a time: enough for the distances between all
/// pairs of sixty rooms. A model, heartbeat or request beyond the limit is declined.
pub const FACTS_PER_OWNER_MAX: usize = 4_096;

/// Maximum number of departed agents with facts that are kept as unknown. If one more agent
/// departs, the facts of the agent that departed first are no longer kept. The limit equals the
/// maximum number of present agents.
pub const DEPARTED_MAX: usize = AGENTS_MAX;

/// Maximum number of predicates that are recorded as having facts that may be unknown. At the
/// limit, the predicates without an unknown fact at present are dropped. A building has some tens.
pub const UNKNOWABLE_MAX: usize = 1_024;

/// Maximum number of facts of the map, including those that requests add to it. A request for more
/// is declined.
pub const MAP_FACTS_MAX: usize = 65_536;

/// Maximum number of owners of facts at a time; a claim of a further owner is declined. An owner
/// need not be an agent with a model: users, tools and other ecosystems also own facts.
pub const OWNERS_MAX: usize = 2 * AGENTS_MAX;

/// Maximum number of departed agents with a remembered incarnation, by which late messages are
/// recognised. The incarnations that started longest ago are dropped first.
pub const FORMER_MAX: usize = 4 * AGENTS_MAX;

/// Maximum number of actions that requests withhold: enough for all actions of thirty agents, one
/// by one. A request to withhold more is declined.
pub const WITHHELD_MAX: usize = 4_096;

/// Maximum number of action schemas that are kept after the last offering agent has left; beyond
/// it, the schemas that were last offered longest ago are dropped. A building has some tens of
/// them. They are used for explanations, and every snapshot contains those without an offering
/// agent.
pub const REMEMBERED_MAX: usize = 64;

const _: () = assert!(FORMER_MAX >= AGENTS_MAX, "all agents may leave at once");
const _: () = assert!(OBJECTS_PER_AGENT_MAX <= FACTS_PER_OWNER_MAX, "each object has a place");
