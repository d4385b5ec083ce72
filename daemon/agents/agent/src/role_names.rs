//! Names of the reasoning agents of an ecosystem, under which other agents and commands address
//! them.

use acl::AgentId;

/// Name of the agent in each reasoning role. The ecosystem file sets the names. By default each
/// agent has the name of its plugin. A command that has not read the file, and a plugin that is a
/// process, use the defaults.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RoleNames {
    /// The agent that keeps the composite domain.
    pub domain_maintainer: AgentId,
    /// The agent that takes goals.
    pub plan_requester: AgentId,
    /// The agent that plans in the centralised planning mode.
    pub planning_agent: AgentId,
    /// The agent that carries plans out.
    pub plan_executor: AgentId,
}

impl Default for RoleNames {
    fn default() -> RoleNames {
        let name = |text| AgentId::new(text).expect("invariant: a literal that is a name");
        RoleNames {
            domain_maintainer: name("domain-maintainer"),
            plan_requester: name("plan-requester"),
            planning_agent: name("planning-agent"),
            plan_executor: name("plan-executor"),
        }
    }
}
