//! Tests of wrong input: in each case the sender gets a clear reason, in bounded time.

use std::time::Duration;

use ::building::BuildingEvent;
use acl::content::{
    Achieve, BelievedState, GoalStatus, Keep, Reason, Refusal, Report, Request, value,
};
use acl::{AgentId, Performative, Protocol};
use agent::{
    Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, LaunchableAgent, Mode, Resource,
};
use keyboard::Keyboard;
use substrate::ResourceQuery;
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout};
use tokio_util::sync::CancellationToken;

use super::strangers::{Conduct, Script, Stranger};
use super::{MODES, Office, Person, entry};
use crate::hosting::supervisor;

const DONE_AT_ONCE: Conduct = Conduct::Confirms(Duration::ZERO);

/// Returns the script of an agent that blesses rooms, which no other agent can do.
fn blesser(name: &str, cost: f64, conduct: Conduct) -> Script {
    Script {
        model: format!(
            "(:predicates (blessed ?r - room)) (:objects {name} - temperature-sensor)
             (:action bless :agent ?s - temperature-sensor :parameters (?r - room)
                 :precondition (and)
                 :effect (and (blessed ?r) (increase (total-cost) {cost})))"
        ),
        facts: String::new(),
        conduct,
        offers: vec![offer("(blessed office1)", &format!("(bless {name} office1)"), cost)],
        asked: Vec::new(),
    }
}

fn offer(conjunct: &str, plan: &str, cost: f64) -> (String, String, f64) {
    (conjunct.to_owned(), format!("{plan}\n"), cost)
}

/// Requests a goal that cannot be reached. Returns the text of the last report, and the time until
/// it came.
async fn last_word(person: &mut Person, goal: &str) -> (String, Duration) {
    let begun = Instant::now();
    assert!(!person.reaches(goal).await, "{:#?}", person.lines);
    (person.lines.last().cloned().expect("a reason"), begun.elapsed())
}

async fn read<T: serde::de::DeserializeOwned>(office: &Office, of: &str, what: Resource) -> T {
    let ask = ResourceQuery { daemon: None, resource: what, agent: AgentId::new(of).ok() };
    let answers = office.node.router().ask(ask, Duration::from_secs(5)).await;
    serde_json::from_slice(answers.first().expect("an answer")).expect("it is one")
}

// === agents that advertise actions that they do not perform ===

#[tokio::test(start_paused = true)]
async fn an_agent_that_refuses_its_own_action_is_named_and_avoided() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let refuses = Conduct::Refuses(Reason::Incapable);
        let liar = Stranger::enter(&office, "liar", blesser("liar", 1.0, refuses)).await;
        let mut person = office.person("user");
        let (why, took) = last_word(&mut person, "(blessed office1)").await;
        let reason = "`bless` of `liar` is not asked for again: `(bless liar office1)`: `liar` \
                      declined: I only say so";
        assert!(why.contains(reason), "{mode:?}: {why}");
        assert!(took < Duration::from_secs(5), "{mode:?}: {took:?}");
        assert_eq!(liar.asked(), ["bless"], "{mode:?}");
        // Another agent's action is used, and the liar is asked once for each goal.
        let honest = blesser("honest", 7.0, DONE_AT_ONCE);
        let honest = Stranger::enter(&office, "honest", honest).await;
        assert!(person.reaches("(blessed office1)").await, "{mode:?}: {:#?}", person.lines);
        assert_eq!((liar.asked().len(), honest.asked().len()), (2, 1), "{mode:?}");
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn an_agent_that_agrees_and_falls_silent_is_tried_three_times() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let silent = blesser("silent", 1.0, Conduct::FallsSilent);
        let silent = Stranger::enter(&office, "silent", silent).await;
        let mut person = office.person("user");
        let (why, took) = last_word(&mut person, "(blessed office1)").await;
        assert!(why.contains("`silent` did not answer in time"), "{mode:?}: {why}");
        assert_eq!(silent.asked().len(), 3, "{mode:?}");
        // Three times the method's timeout, with thirty seconds between the attempts.
        assert!(took < Duration::from_secs(120), "{mode:?}: {took:?}");
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_full_mailbox_is_reported_and_retried() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let conduct = Conduct::RefusesAtFirst(2, Reason::MailboxFull);
        let busy = Stranger::enter(&office, "busy", blesser("busy", 1.0, conduct)).await;
        let mut person = office.person("user");
        let begun = Instant::now();
        assert!(person.reaches("(blessed office1)").await, "{mode:?}: {:#?}", person.lines);
        assert!(begun.elapsed() < Duration::from_secs(5), "nobody is to blame, {mode:?}");
        let told = person.lines.iter().filter(|line| line.contains("`busy` declined: my mailbox"));
        assert_eq!(told.count(), 2, "{mode:?}: {:#?}", person.lines);
        assert_eq!(busy.asked().len(), 3, "{mode:?}");
        office.close().await;
    }
}

/// An agent that requests many goals at one instant, and forwards the answers to the test.
struct Flood {
    asks: usize,
    heard: mpsc::UnboundedSender<String>,
}

impl Agent for Flood {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        for _ in 0..self.asks {
            let goal = "(at turtlebot-1 office2)".to_owned();
            let achieve = Achieve::new(goal, Keep::Achieve, 0);
            let opening = ExchangeOpening {
                to: AgentId::new("plan-requester").ok(),
                performative: Performative::Request,
                protocol: Protocol::Goal,
                conversation: ctx.new_conversation(),
                content: value(&Request::Achieve(achieve)),
            };
            ctx.open(opening, Duration::from_secs(60), |flood: &mut Self, answer, _| {
                let word = match answer {
                    ExchangeEvent::Message(message) => match message.content_as::<Refusal>() {
                        Ok(refusal) => format!("{:?}: {}", refusal.reason, refusal.detail),
                        Err(_) => message.content_as::<Report>().expect("a report").detail,
                    },
                    ExchangeEvent::TimedOut | ExchangeEvent::Undelivered(_) => "nothing".to_owned(),
                };
                let _ = flood.heard.send(word);
            });
        }
    }
}

#[tokio::test(start_paused = true)]
async fn messages_beyond_a_full_mailbox_are_refused_at_once() {
    let robot = entry("turtlebot-1", "turtlebot", "{ start = \"office2\" }");
    let office = Office::open(&[robot], Mode::Decentralized).await;
    let room = office.ecosystem.settings.mailbox_messages_max;
    let (heard, mut hear) = mpsc::unbounded_channel();
    let flood = Flood { asks: room + 50, heard };
    office.node.launch(AgentId::new("flood").expect("a name"), flood, "smart-office");
    let (mut full, mut held) = (0, 0);
    let begun = Instant::now();
    for _ in 0..room + 50 {
        let word =
            timeout(Duration::from_secs(30), hear.recv()).await.expect("every one is answered");
        match word.expect("it lives").as_str() {
            "MailboxFull: the mailbox of `plan-requester` is full; ask again later" => full += 1,
            "it holds already" => held += 1,
            other => panic!("{other}"),
        }
    }
    assert!(full >= 50, "{full} found no room");
    assert!(held >= room - 50, "{held} were served");
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
    let mut person = office.person("user");
    assert!(person.reaches("(at turtlebot-1 office2)").await, "there is room again");
    office.close().await;
}

// === a model that changes under a running plan ===

/// Returns the script of an agent that needs candles before it can bless a room. Each of its
/// actions, such as fetching the candles, takes five seconds.
fn careful(more: &str, before: &str) -> Script {
    let conduct = Conduct::Confirms(Duration::from_secs(5));
    let plan = "(fetch guest)\n(bless guest office1)";
    Script {
        model: format!(
            "(:predicates (blessed ?r - room) (candles ?s - temperature-sensor)
                 (lit ?r - room))
             (:objects guest - temperature-sensor)
             (:action fetch :agent ?s - temperature-sensor :parameters ()
                 :precondition (and) :effect (and (candles ?s) (increase (total-cost) 1)))
             (:action light :agent ?s - temperature-sensor :parameters (?r - room)
                 :precondition (candles ?s)
                 :effect (and (lit ?r) (increase (total-cost) 1)))
             {more}"
        )
        .replace("BEFORE", before),
        offers: vec![offer("(blessed office1)", plan, 2.0)],
        ..blesser("guest", 1.0, conduct)
    }
}

const BLESS: &str = "(:action bless :agent ?s - temperature-sensor :parameters (?r - room)
    :precondition (and (candles ?s) BEFORE)
    :effect (and (blessed ?r) (increase (total-cost) 1)))";

/// Requests a blessing, and waits until the guest is fetching candles for it.
async fn until_it_fetches(person: &mut Person, guest: &Stranger) {
    person.wish("(blessed office1)", Keep::Achieve).await;
    while guest.asked() != ["fetch"] {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_plan_is_repaired_when_an_action_needs_more_than_it_did() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let guest = Stranger::enter(&office, "guest", careful(BLESS, "")).await;
        let mut person = office.person("user");
        until_it_fetches(&mut person, &guest).await;
        guest.script(|script| {
            let changed = careful(BLESS, "(lit ?r)");
            script.model = changed.model;
            let plan = "(fetch guest)\n(light guest office1)\n(bless guest office1)";
            script.offers = vec![offer("(blessed office1)", plan, 3.0)];
            let plan = "(light guest office1)\n(bless guest office1)";
            script.offers.push(offer("(blessed office1)", plan, 2.0));
        });
        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
        let told = person.lines.join("\n");
        let changed = "takes or does something else now: `bless` of `guest`";
        assert!(told.contains(changed), "{mode:?}: {told}");
        assert!(told.contains("the rest of the plan does not reach the goal"), "{mode:?}: {told}");
        let asked = guest.asked();
        assert!(asked.ends_with(&["light".to_owned(), "bless".to_owned()]), "{mode:?}: {asked:?}");
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_plan_goes_on_when_a_change_does_not_matter_to_it() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let guest = Stranger::enter(&office, "guest", careful(BLESS, "")).await;
        let mut person = office.person("user");
        until_it_fetches(&mut person, &guest).await;
        guest.script(|script| script.model = careful(BLESS, "(not (lit ?r))").model);
        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
        assert_eq!(guest.asked(), ["fetch", "bless"], "{mode:?}: {:#?}", person.lines);
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn an_agent_that_withdraws_an_action_of_a_running_plan_is_named() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let guest = Stranger::enter(&office, "guest", careful(BLESS, "")).await;
        let mut person = office.person("user");
        until_it_fetches(&mut person, &guest).await;
        guest.script(|script| {
            script.model = careful("", "").model;
            script.offers.clear();
        });
        assert!(!person.hears().await, "{mode:?}: {:#?}", person.lines);
        let told = person.lines.join("\n");
        assert!(told.contains("`guest` does not offer `bless` any more"), "{mode:?}: {told}");
        assert!(told.contains("is not offered now: `bless` of `guest`"), "{mode:?}: {told}");
        let last = person.lines.last().expect("a reason");
        assert!(last.contains("`guest` does not offer `bless` now"), "{mode:?}: {told}");
        office.close().await;
    }
}

// === an actuator that confirms what is not true ===

/// Returns the script of an agent that confirms that it has moved, and then reports facts that
/// contradict it.
fn stuck(name: &str, cost: f64) -> Script {
    Script {
        model: format!(
            "(:predicates (parked ?s - temperature-sensor ?r - room) (served ?r - room))
             (:objects {name} - temperature-sensor) (:init (parked {name} office2))
             (:action park :agent ?s - temperature-sensor :parameters (?from ?to - room)
                 :precondition (parked ?s ?from)
                 :effect (and (not (parked ?s ?from)) (parked ?s ?to)
                     (increase (total-cost) {cost})))"
        ),
        facts: format!("(parked {name} office2)"),
        conduct: DONE_AT_ONCE,
        offers: vec![offer(
            &format!("(parked {name} office1)"),
            &format!("(park {name} office2 office1)"),
            cost,
        )],
        asked: Vec::new(),
    }
}

#[tokio::test(start_paused = true)]
async fn a_confirmation_that_heartbeats_contradict_is_rejected() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let stuck = Stranger::enter(&office, "stuck", stuck("stuck", 1.0)).await;
        let mut person = office.person("user");
        let (why, took) = last_word(&mut person, "(parked stuck office1)").await;
        let reason = "`(park stuck office2 office1)`: `stuck` confirmed it, yet says `(parked \
                      stuck office2)`";
        assert!(why.contains(reason), "{mode:?}: {why}");
        assert_eq!(stuck.asked().len(), 3, "{mode:?}: tried again, and not for ever");
        assert!(took < Duration::from_secs(60), "{mode:?}: {took:?}");
        // A kept goal is retried ever more rarely, and the user gets a report each time.
        person.lines.clear();
        person.wish("(parked stuck office1)", Keep::Maintain).await;
        let ten_minutes = tokio::time::sleep(Duration::from_secs(600));
        tokio::select! {
            held = person.hears() => panic!("{held} {mode:?}: {:#?}", person.lines),
            () = ten_minutes => (),
        }
        assert!((5..=12).contains(&stuck.asked().len()), "{mode:?}: {:?}", stuck.asked());
        assert!(person.lines.iter().any(|line| line.contains(reason)), "{:#?}", person.lines);
        // The agent is no longer stuck: what it confirms is true.
        stuck.script(|script| script.facts = "(parked stuck office1)".to_owned());
        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_plan_that_rests_on_a_false_confirmation_ends_there() {
    for mode in MODES {
        let office = Office::open(&[], mode).await;
        let serve = "(:action serve :agent ?s - temperature-sensor :parameters (?r - room)
            :precondition (parked ?s ?r)
            :effect (and (served ?r) (increase (total-cost) 1)))";
        let plan = "(park stuck office2 office1)\n(serve stuck office1)";
        let base = stuck("stuck", 1.0);
        let script = Script {
            model: format!("{}\n{serve}", base.model),
            conduct: Conduct::Confirms(Duration::from_secs(5)),
            offers: vec![offer("(served office1)", plan, 2.0)],
            ..base
        };
        let stuck = Stranger::enter(&office, "stuck", script).await;
        let mut person = office.person("user");
        person.wish("(served office1)", Keep::Achieve).await;
        person.hears_of("a plan of 2 steps").await;
        let begun = Instant::now();
        person.hears_of("`stuck` confirmed it, yet says `(parked stuck office2)`").await;
        // Five seconds for the first step, and a heartbeat: the second step is not waited for.
        assert!(begun.elapsed() < Duration::from_secs(8), "{mode:?}: {:?}", begun.elapsed());
        assert_eq!(stuck.asked(), ["park", "serve"], "{mode:?}");
        assert!(!person.hears().await, "{mode:?}: {:#?}", person.lines);
        let asked = stuck.asked();
        // The Domain Maintainer may receive the confirmation after the heartbeat that contradicts
        // it, and believe it until the next heartbeat: then the second step is requested once more.
        let parked = asked.iter().filter(|action| *action == "park").count();
        assert!(parked == 3 && asked.len() <= 9, "{mode:?}: {asked:?} {:#?}", person.lines);
        office.close().await;
    }
}

// === observations that contradict each other ===

#[tokio::test(start_paused = true)]
async fn contradicting_measurements_do_not_alternate() {
    let office = Office::open(&[], Mode::Decentralized).await;
    for (name, celsius) in [("first", 18), ("second", 21)] {
        let facts = format!("(= (temperature office1) {celsius})");
        let script = Script { facts, ..blesser(name, 1.0, DONE_AT_ONCE) };
        Stranger::enter(&office, name, script).await;
    }
    tokio::time::sleep(Duration::from_secs(3)).await;
    let state = async || read::<BelievedState>(&office, "domain-maintainer", Resource::State).await;
    let before = state().await;
    for _ in 0..100 {
        tokio::time::sleep(Duration::from_millis(100)).await;
        assert_eq!(state().await.revision, before.revision, "nothing has changed");
    }
    let after = state().await;
    let fact = after.facts.iter().find(|fact| fact.fact.contains("temperature office1"));
    let fact = fact.expect("it is believed");
    assert_eq!(fact.fact, "(= (temperature office1) 21)", "the word that changed last");
    let said: Vec<_> =
        fact.claims.iter().map(|claim| (&*claim.owner, &*claim.fact, &*claim.source)).collect();
    let (eighteen, twenty_one) = ("(= (temperature office1) 18)", "(= (temperature office1) 21)");
    let expected = [("first", eighteen, "heartbeat"), ("second", twenty_one, "heartbeat")];
    assert_eq!(said, expected);
    office.close().await;
}

// === a question without an answer ===

#[tokio::test(start_paused = true)]
async fn an_unanswered_question_ends_with_that_reason() {
    for mode in MODES {
        let login = "{ start = \"office2\", login = { pin = \"2718\", patience = \"20s\" } }";
        let office = Office::open(&[entry("turtlebot-1", "turtlebot", login)], mode).await;
        let mut person = office.person("user");
        let (why, took) = last_word(&mut person, "(validated office2)").await;
        assert!(why.contains("no answer came within 20s"), "{mode:?}: {why}");
        assert!(took < Duration::from_secs(180), "{mode:?}: {took:?}");
        office.close().await;
    }
}

// === goals that are true already, and goals that never will be ===

#[tokio::test(start_paused = true)]
async fn a_goal_that_holds_already_causes_no_action() {
    for mode in MODES {
        let robot = entry("turtlebot-1", "turtlebot", "{ start = \"office2\" }");
        let office = Office::open(&[robot], mode).await;
        let mut person = office.person("user");
        assert!(person.reaches("(at turtlebot-1 office2)").await, "{:#?}", person.lines);
        assert_eq!(person.lines, ["it holds already"], "{mode:?}");
        let truth = office.building.truth();
        assert!(!truth.any(|event| matches!(event, BuildingEvent::Moved { .. })), "{mode:?}");
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_goal_that_can_never_be_true_names_the_conjunct() {
    for mode in MODES {
        let robot = entry("turtlebot-1", "turtlebot", "{ start = \"office2\" }");
        let office = Office::open(&[robot], mode).await;
        let mut person = office.person("user");
        let cases = [
            (
                "(and (at turtlebot-1 office1) (connected office1 office2))",
                "(connected office1 office2)",
            ),
            (
                "(and (at turtlebot-1 office1) (not (at turtlebot-1 office1)))",
                "it requires `(at turtlebot-1 office1)` and `(not",
            ),
            ("(and (at turtlebot-1 office1) (at turtlebot-1 attic))", "attic"),
        ];
        for (goal, named) in cases {
            let (why, took) = last_word(&mut person, goal).await;
            assert!(why.contains(named), "{mode:?} {goal}: {why}");
            assert!(took < Duration::from_secs(30), "{mode:?} {goal}: {took:?}");
        }
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_goal_of_too_many_conditions_is_refused_and_delays_no_other() {
    let variables: Vec<String> = (1..=30).map(|number| format!("?v{number}")).collect();
    let variables = format!("({} - location)", variables.join(" "));
    for mode in MODES {
        let robot = entry("turtlebot-1", "turtlebot", "{ start = \"office2\" }");
        let office = Office::open(&[robot], mode).await;
        let (mut hasty, mut person) = (office.person("hasty"), office.person("user"));
        for (body, limit) in [
            // Written out, more conditions than any memory holds.
            (
                "forall {} (imply (connected ?v1 ?v2) (or (connected ?v2 ?v1) (connected ?v3 ?v4)))",
                "more than 200000 conditions and terms",
            ),
            // One condition, of which every combination of places has to be tried.
            ("exists {} (not (= ?v30 ?v30))", "more than 3000000 steps"),
        ] {
            let goal = format!("({})", body.replace("{}", &variables));
            hasty.wish(&goal, Keep::Achieve).await;
            let room = if limit.contains("steps") { "office1" } else { "conf-room" };
            let other = format!("(at turtlebot-1 {room})");
            assert!(person.reaches(&other).await, "{mode:?}: {:#?}", person.lines);
            assert!(!hasty.hears().await, "{mode:?}: {:#?}", hasty.lines);
            let why = hasty.lines.last().expect("a reason");
            assert!(
                why.contains("the goal is too large") && why.contains(limit),
                "{mode:?}: {why}"
            );
        }
        office.close().await;
    }
}

// === a user agent that is restarted and requests its goal again ===

#[tokio::test(start_paused = true)]
async fn a_restarted_requester_keeps_its_goal_once() {
    for mode in MODES {
        let config = "{ start = \"office2\" }";
        let robots = ["turtlebot-1", "turtlebot-2"].map(|name| entry(name, "turtlebot", config));
        let office = Office::open(&robots, mode).await;
        // Incarnations that receive the report that the goal holds, and one that ends while the
        // robot is on its way.
        for (robot, patience) in [(1, 60), (1, 60), (2, 0), (2, 60)] {
            let stopping = CancellationToken::new();
            let (keyboard, terminal) = Keyboard::with_terminal();
            let id = AgentId::new("camera").expect("a name");
            let router = office.node.router();
            let launch_context =
                supervisor::launch_context(&id, router, "smart-office", &stopping, false);
            let task = Box::new(keyboard).launch(launch_context);
            let mut asker = Person { terminal, lines: Vec::new() };
            let goal = format!("(at turtlebot-{robot} office1)");
            asker.wish(&goal, Keep::Maintain).await;
            let heard = timeout(Duration::from_secs(patience), asker.hears()).await;
            assert!(heard.unwrap_or(patience == 0), "{mode:?}: {:#?}", asker.lines);
            tokio::time::sleep(Duration::from_secs(1)).await;
            let kept: Vec<GoalStatus> = read(&office, "plan-requester", Resource::Goals).await;
            let same = kept.iter().filter(|kept| kept.goal == goal);
            assert_eq!(same.count(), 1, "{mode:?}: {kept:#?}");
            stopping.cancel();
            task.await.expect("it ends").expect("in peace");
        }
        office.close().await;
    }
}
