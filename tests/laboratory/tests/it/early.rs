//! A Plan Requester that leads before any Journal can be read: it cancels goals that only the Journal
//! has, and gives no number that such a goal has.

use std::sync::Arc;
use std::time::Duration;

use acl::content::{Keep, Outcome, Report};
use acl::{ConversationId, Performative, Protocol};
use agent::{Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, MessageRouter, Mode};
use serde_json::json;
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::house::lamp::kept_goal;
use crate::house::opening_journal::{JournalFile, OpeningJournal};
use crate::house::sayer::{PATIENCE, Sayer};
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips) (:predicates (lit)))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:init) (:goal (and)))";

/// Cancels a goal in an exchange of its own, and passes on the answer.
struct Canceller(mpsc::UnboundedSender<Performative>);

impl Agent for Canceller {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: Some(name("plan-requester")),
            performative: Performative::Cancel,
            protocol: Protocol::Goal,
            conversation: ConversationId::new("g"),
            content: serde_json::Value::Null,
        };
        ctx.open(opening, PATIENCE, |canceller: &mut Canceller, answer, _| {
            if let ExchangeEvent::Message(message) = answer {
                canceller.0.send(message.performative).expect("the test listens");
            }
        });
    }
}

/// A machine with a Plan Requester, and a Journal that has the goal `g` and is not open yet. There is
/// no Domain Maintainer, so each goal waits.
struct Started {
    here: Arc<MessageRouter>,
    file: JournalFile,
    /// Keeps the network alive.
    _house: House,
}

impl Started {
    async fn start() -> Started {
        let house = House::new(Mode::Centralized, DOMAIN, PROBLEM, vec![name("journal")]);
        let here = house.machine("here");
        let kept = kept_goal(&json!({
            "number": 1, "asked": { "goal": "(lit)", "keep": "maintain" }, "failures": 0
        }));
        let (journal, file) = OpeningJournal::new(kept);
        drop(launch(Box::new(journal), "journal", &here, false));
        drop(launch(house.built(&plan_requester::PLUGIN), "plan-requester", &here, true));
        tokio::time::sleep(Duration::from_secs(1)).await;
        Started { here, file, _house: house }
    }

    fn cancel(&self) -> mpsc::UnboundedReceiver<Performative> {
        let (told, heard) = mpsc::unbounded_channel();
        drop(launch(Box::new(Canceller(told)), "canceller", &self.here, false));
        heard
    }

    /// Returns the outcome with which the goal `g` ended by the records of the Journal.
    fn end(&mut self) -> Option<String> {
        let stored = self.file.take_stored();
        let last = stored.iter().rev().find(|record| record.key == "goal/g")?;
        last.body["ended"]["outcome"].as_str().map(ToOwned::to_owned)
    }
}

#[tokio::test(start_paused = true)]
async fn a_goal_is_cancelled_that_only_an_unread_journal_has() {
    let mut started = Started::start().await;
    let mut answers = started.cancel();
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert!(answers.try_recv().is_err(), "it is not known yet whether there is such a goal");
    started.file.open();
    let answer = timeout(PATIENCE, answers.recv()).await.expect("in time");
    assert_eq!(answer, Some(Performative::Confirm));
    assert_eq!(started.end().as_deref(), Some("cancelled"));
}

#[tokio::test(start_paused = true)]
async fn a_cancellation_is_answered_when_no_journal_opens_and_applies_when_one_does() {
    let mut started = Started::start().await;
    let mut answers = started.cancel();
    let answer = timeout(PATIENCE, answers.recv()).await.expect("in time");
    assert_eq!(answer, Some(Performative::Refuse), "no Journal can be read");
    started.file.open();
    tokio::time::sleep(Duration::from_secs(10)).await;
    assert_eq!(started.end().as_deref(), Some("cancelled"));
}

#[tokio::test(start_paused = true)]
async fn a_new_goal_gets_no_number_that_a_goal_of_an_unread_journal_has() {
    let started = Started::start().await;
    let (told, mut heard) = mpsc::unbounded_channel();
    let (sayer, _) = Sayer::of_goal("(lit)", Keep::Maintain);
    let sayer = Sayer { conversation: "n", told, ..sayer };
    drop(launch(Box::new(sayer), "asker", &started.here, false));
    tokio::time::sleep(Duration::from_secs(2)).await;
    started.file.open();
    let accepted = async {
        loop {
            let report: Report = heard.recv().await.expect("it lives");
            assert_eq!(report.outcome, Outcome::Progress, "{report:?}");
            if report.detail.contains("accepted") {
                return report.detail;
            }
        }
    };
    let accepted = timeout(PATIENCE, accepted).await.expect("in time");
    assert_eq!(accepted, "goal 2 accepted; kept by `journal`, 1 of 1");
}
