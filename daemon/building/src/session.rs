//! One client at the building's socket: receives its requests, runs them, answers.
//!
//! Requests of one client run concurrently. They end with the client: when its task returns, its operations
//! are aborted, and the building cancels them. `server` decides which clients may connect; the building
//! defines what a request does.

use std::collections::BTreeMap;
use std::io;

use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::task::{AbortHandle, JoinError, JoinSet};
use tokio::time::{Interval, MissedTickBehavior, interval};
use tracing::Instrument as _;

use crate::error::DeviceError;
use crate::handle::BuildingHandle;
use crate::wire::{ALIVE_PERIOD, Answer, Ask, IN_FLIGHT_MAX, Line, Lines, Request, write_line};

/// The task of one client, with the operations that run for it.
pub(crate) struct Session {
    building: BuildingHandle,
    lines: Lines<OwnedReadHalf>,
    writer: OwnedWriteHalf,
    operations: JoinSet<Line>,
    running: BTreeMap<u64, AbortHandle>,
    alive: Interval,
}

/// An event that wakes a client's task.
enum Event {
    Line(io::Result<Option<Vec<u8>>>),
    Finished(Result<Line, JoinError>),
    AliveDue,
}

impl Session {
    pub(crate) fn new(building: BuildingHandle, stream: UnixStream) -> Session {
        let (reader, writer) = stream.into_split();
        let mut alive = interval(ALIVE_PERIOD);
        alive.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Session {
            building,
            lines: Lines::new(reader),
            writer,
            operations: JoinSet::new(),
            running: BTreeMap::new(),
            alive,
        }
    }

    pub(crate) async fn run(mut self) {
        loop {
            let event = self.next_event().await;
            match self.handle(event).await {
                Ok(true) => (),
                Ok(false) => return,
                Err(err) => {
                    tracing::debug!(%err, "a client's connection ends");
                    return;
                }
            }
        }
    }

    async fn next_event(&mut self) -> Event {
        tokio::select! {
            line = self.lines.next() => Event::Line(line),
            Some(finished) = self.operations.join_next() => Event::Finished(finished),
            _ = self.alive.tick() => Event::AliveDue,
        }
    }

    /// Handles one event. Returns `false` if the connection has ended.
    async fn handle(&mut self, event: Event) -> io::Result<bool> {
        match event {
            Event::Line(line) => match line? {
                Some(line) => self.hear(&line).await?,
                None => return Ok(false),
            },
            Event::Finished(Ok(line)) => self.tell(line).await?,
            // The operation was cancelled: the client does not wait for an answer.
            Event::Finished(Err(_)) => (),
            Event::AliveDue => write_line(&mut self.writer, &Line::Alive).await?,
        }
        Ok(true)
    }

    async fn hear(&mut self, line: &[u8]) -> io::Result<()> {
        match serde_json::from_slice(line) {
            Ok(Request { id, ask: Ask::Cancel }) => {
                if let Some(operation) = self.running.remove(&id) {
                    operation.abort();
                }
                Ok(())
            }
            Ok(Request { id, ask }) => match self.start(id, ask) {
                Ok(()) => Ok(()),
                Err(reason) => self.refuse(id, reason).await,
            },
            Err(err) => self.refuse(id_of(line), format!("not understood: {err}")).await,
        }
    }

    fn start(&mut self, id: u64, ask: Ask) -> Result<(), String> {
        if self.running.contains_key(&id) {
            return Err(format!("request {id} is under way; choose another id"));
        }
        if self.running.len() >= IN_FLIGHT_MAX {
            return Err(format!("{IN_FLIGHT_MAX} requests are under way; wait for one"));
        }
        let building = self.building.clone();
        let operation = async move {
            match perform(&building, ask).await {
                Ok(answer) => Line::Done { id, answer },
                Err(error) => Line::Failed { id, error },
            }
        };
        self.running.insert(id, self.operations.spawn(operation.in_current_span()));
        Ok(())
    }

    async fn tell(&mut self, line: Line) -> io::Result<()> {
        if let Line::Done { id, .. } | Line::Failed { id, .. } = &line
            && self.running.remove(id).is_none()
        {
            // The operation finished in the instant in which it was cancelled.
            return Ok(());
        }
        write_line(&mut self.writer, &line).await
    }

    async fn refuse(&mut self, id: u64, reason: String) -> io::Result<()> {
        let error = DeviceError::Refused { reason };
        write_line(&mut self.writer, &Line::Failed { id, error }).await
    }
}

async fn perform(building: &BuildingHandle, ask: Ask) -> Result<Answer, DeviceError> {
    match ask {
        Ask::ReadTemperature { sensor } => {
            building.read_temperature(&sensor).await.map(Answer::Reading)
        }
        Ask::Navigate { robot, to } => {
            building.navigate(&robot, &to).await.map(|()| Answer::Arrived)
        }
        Ask::PlaceOf { device } => building.place_of(&device).await.map(Answer::Place),
        Ask::Measure { sensor, quantity } => {
            building.measure(&sensor, quantity).await.map(Answer::Measured)
        }
        Ask::AwaitChange { sensor, quantity, known } => {
            building.await_change(&sensor, quantity, known).await.map(Answer::Measured)
        }
        Ask::Battery(ask) => building.battery(ask).await.map(Answer::Battery),
        Ask::Cleaning(ask) => building.cleaning(ask).await.map(Answer::Cleaning),
        Ask::Camera(ask) => building.camera(ask).await.map(Answer::Camera),
        Ask::Screen(ask) => building.screen(ask).await.map(Answer::Screen),
        Ask::Cancel => Err(DeviceError::Refused { reason: "nothing to cancel".to_owned() }),
    }
}

/// Returns the id of a request that is otherwise not understood; 0 if it has none.
fn id_of(line: &[u8]) -> u64 {
    #[derive(serde::Deserialize)]
    struct Numbered {
        id: u64,
    }
    serde_json::from_slice(line).map_or(0, |Numbered { id }| id)
}
