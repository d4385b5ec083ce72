//! Tests of reasoning agents that the ecosystem file calls otherwise than their plugins.

use keyboard::{UserEvent, UserRequest};
use substrate::memory::Network;

use super::{MODES, Office, entry};

#[tokio::test(start_paused = true)]
async fn reasoning_agents_are_found_under_the_names_of_the_file() {
    for mode in MODES {
        let entries = [
            entry("domain-maintainer", "domain-maintainer", "{}"),
            entry("wishes", "plan-requester", "{}"),
            entry("brain", "planning-agent", "{}"),
            entry("hands", "plan-executor", "{}"),
            entry("turtlebot-1", "turtlebot", "{ start = \"corridor\" }"),
        ];
        let office = Office::with_agents(Network::new(), &entries, mode).await;
        let mut person = office.person("user");
        assert!(person.reaches("(at turtlebot-1 office1)").await, "{mode:?} {:#?}", person.lines);
        let action = UserRequest::Act("(move turtlebot-1 office1 corridor)".to_owned());
        let id = person.terminal.requests.send(action).await.expect("the keyboard listens");
        let end =
            |heard: UserEvent| heard.is_final().then(|| (heard.request(), heard.is_success()));
        assert_eq!(person.waits(end).await, (Some(id), true), "{mode:?}");
        assert_eq!(office.building.truth().place_of("turtlebot-1"), Some("corridor"));
        office.close().await;
    }
}

/// The entry of the Plan Requester names one of two Plan Executors; a person's action goes to the
/// same.
#[tokio::test(start_paused = true)]
async fn the_names_in_the_entry_of_the_plan_requester_count() {
    let entries = [
        entry("domain-maintainer", "domain-maintainer", "{}"),
        entry("idle", "plan-executor", "{ domain-maintainer = \"nobody\" }"),
        entry("hands", "plan-executor", "{}"),
        entry("plan-requester", "plan-requester", "{ plan-executor = \"hands\" }"),
        entry("turtlebot-1", "turtlebot", "{ start = \"corridor\" }"),
    ];
    let office = Office::with_agents(Network::new(), &entries, MODES[1]).await;
    let roles = &office.ecosystem.settings.roles;
    assert_eq!(roles.plan_executor.as_str(), "hands");
    let mut person = office.person("user");
    assert!(person.reaches("(at turtlebot-1 office1)").await, "{:#?}", person.lines);
    office.close().await;
}
