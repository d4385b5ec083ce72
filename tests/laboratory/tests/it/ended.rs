//! Merging of goal records from another replica of the Plan Requester that led in another
//! partition: an end on either side is final.

use std::sync::Arc;
use std::time::Duration;

use acl::content::{Keep, Outcome, Record, Report, Request, StoreRecords, Version};
use acl::{Performative, Protocol};
use agent::{Agent, Callbacks, Context, MessageRouter, Mode, Participation, Resource};
use substrate::ResourceQuery;
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::house::sayer::{PATIENCE, Sayer};
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips)
    (:predicates (lit)))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:init (lit)) (:goal (and)))";

/// A Journal that passes on all records it is asked to keep.
struct Journal(mpsc::UnboundedSender<Record>);

impl Agent for Journal {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |journal: &mut Journal, message, ctx| {
            if let Ok(Request::StoreRecords(StoreRecords { records })) =
                message.content_as::<Request>()
            {
                records.into_iter().for_each(|record| journal.0.send(record).expect("it is read"));
            }
            let report = Report::new(Outcome::Done, "kept");
            ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
        })
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        (resource == Resource::Journal).then(|| "[]".to_owned())
    }
}

/// Waits for a record that satisfies `is_it`.
async fn kept(
    records: &mut mpsc::UnboundedReceiver<Record>,
    is_it: impl Fn(&Record) -> bool,
) -> Record {
    let found = async {
        loop {
            let record = records.recv().await.expect("the Journal lives");
            if is_it(&record) {
                return record;
            }
        }
    };
    timeout(PATIENCE, found).await.expect("in time")
}

fn is_goal(record: &Record) -> bool {
    record.key == "goal/g"
}

/// A machine with a Plan Requester that was asked for a goal that already holds, and the records of
/// that goal: from its acceptance, and from its end.
struct Asked {
    house: House,
    here: Arc<MessageRouter>,
    records: mpsc::UnboundedReceiver<Record>,
    heard: mpsc::UnboundedReceiver<Report>,
    open: Record,
    ended: Record,
}

impl Asked {
    async fn open() -> Asked {
        let house = House::new(Mode::Centralized, DOMAIN, PROBLEM, vec![name("journal")]);
        let here = house.machine("here");
        let (keeps, mut records) = mpsc::unbounded_channel();
        drop(launch(Box::new(Journal(keeps)), "journal", &here, false));
        drop(launch(house.built(&domain_maintainer::PLUGIN), "domain-maintainer", &here, true));
        drop(launch(house.built(&plan_requester::PLUGIN), "plan-requester", &here, true));
        tokio::time::sleep(Duration::from_secs(1)).await;
        let (sayer, mut heard) = Sayer::of_goal("(lit)", Keep::Achieve);
        drop(launch(Box::new(sayer), "asker", &here, false));
        let has_ended = |record: &Record| record.body.get("ended").is_some();
        let open = kept(&mut records, |record| is_goal(record) && !has_ended(record)).await;
        let ended = kept(&mut records, |record| is_goal(record) && has_ended(record)).await;
        while next(&mut heard).await.outcome != Outcome::Done {}
        Asked { house, here, records, heard, open, ended }
    }

    /// Hands a record over, as a replica does that led elsewhere and stands down.
    async fn is_handed(&self, record: Record) {
        let there = self.house.machine("there");
        let (told, mut heard) = mpsc::unbounded_channel();
        let sayer = Sayer {
            to: name("plan-requester"),
            protocol: Protocol::StateChange,
            conversation: "handing-over",
            says: Request::StoreRecords(StoreRecords { records: vec![record] }),
            told,
        };
        drop(launch(Box::new(sayer), "plan-requester", &there, true));
        let report = next(&mut heard).await;
        assert_eq!(report.outcome, Outcome::Done, "{report:?}");
    }

    async fn has_no_goal(&self) {
        let ask = ResourceQuery {
            daemon: Some(self.here.daemon().clone()),
            resource: Resource::Goals,
            agent: Some(name("plan-requester")),
        };
        assert_eq!(self.here.ask(ask, PATIENCE).await, ["[]"]);
    }
}

async fn next(heard: &mut mpsc::UnboundedReceiver<Report>) -> Report {
    timeout(PATIENCE, heard.recv()).await.expect("in time").expect("it lives")
}

#[tokio::test(start_paused = true)]
async fn an_ended_goal_is_not_restarted_from_a_later_record() {
    let mut asked = Asked::open().await;
    // The other leader read the record from before the end.
    let version = Version { term: u64::MAX / 2, count: 7 };
    asked.is_handed(Record { version, ..asked.open.clone() }).await;
    let is_later = |record: &Record| is_goal(record) && record.version > version;
    let again = kept(&mut asked.records, is_later).await;
    assert_eq!(again.body["ended"], asked.ended.body["ended"], "{again:?}");
    asked.has_no_goal().await;
}

#[tokio::test(start_paused = true)]
async fn a_cancelled_goal_is_not_continued_after_failover() {
    let mut asked = Asked::open().await;
    let version = Version { term: u64::MAX / 2, count: 7 };
    let mut other = Record { key: "goal/h".to_owned(), version, ..asked.open.clone() };
    // The cancellation was confirmed before the goal had ended.
    other.body["participation"]["conversation"] = "h".into();
    other.body["cancelled"] = true.into();
    asked.is_handed(other).await;
    let is_it = |record: &Record| record.key == "goal/h" && record.version > version;
    let again = kept(&mut asked.records, is_it).await;
    assert_eq!(again.body["ended"]["outcome"], "cancelled", "{again:?}");
    asked.has_no_goal().await;
    assert!(asked.heard.try_recv().is_err(), "of the other goal nothing is said any more");
}
