//! One client at the building's socket: receives the requests of the client, runs them, and sends
//! the answers.
//!
//! Requests of one client run concurrently. When the client's task returns, its operations are
//! aborted, and the building cancels them. `server` decides which clients may connect; the building
//! defines the effects of requests.

use std::collections::BTreeMap;
use std::io;

use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::task::{AbortHandle, JoinError, JoinSet};
use tokio::time::{Interval, MissedTickBehavior, interval};
use tracing::Instrument as _;

use crate::driver_requests::{DriverAnswer, DriverRequest};
use crate::error::DeviceError;
use crate::handle::BuildingHandle;
use crate::wire::{ALIVE_PERIOD, IN_FLIGHT_MAX, LineReader, ServerLine, WireRequest, write_line};

/// Task of one client, with the operations that run for the client.
pub(crate) struct Session {
    building: BuildingHandle,
    lines: LineReader<OwnedReadHalf>,
    writer: OwnedWriteHalf,
    operations: JoinSet<ServerLine>,
    running: BTreeMap<u64, AbortHandle>,
    alive: Interval,
}

/// An event that wakes a client's task.
enum SessionEvent {
    Line(io::Result<Option<Vec<u8>>>),
    Finished(Result<ServerLine, JoinError>),
    AliveDue,
}

impl Session {
    pub(crate) fn new(building: BuildingHandle, stream: UnixStream) -> Session {
        let (reader, writer) = stream.into_split();
        let mut alive = interval(ALIVE_PERIOD);
        alive.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Session {
            building,
            lines: LineReader::new(reader),
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

    async fn next_event(&mut self) -> SessionEvent {
        tokio::select! {
            line = self.lines.next() => SessionEvent::Line(line),
            Some(finished) = self.operations.join_next() => SessionEvent::Finished(finished),
            _ = self.alive.tick() => SessionEvent::AliveDue,
        }
    }

    /// Handles one event. Returns `false` if the connection has ended.
    async fn handle(&mut self, event: SessionEvent) -> io::Result<bool> {
        match event {
            SessionEvent::Line(line) => match line? {
                Some(line) => self.handle_line(&line).await?,
                None => return Ok(false),
            },
            SessionEvent::Finished(Ok(line)) => self.send_line(line).await?,
            // The operation was cancelled, so that the client expects no answer.
            SessionEvent::Finished(Err(_)) => (),
            SessionEvent::AliveDue => write_line(&mut self.writer, &ServerLine::Alive).await?,
        }
        Ok(true)
    }

    async fn handle_line(&mut self, line: &[u8]) -> io::Result<()> {
        match serde_json::from_slice(line) {
            Ok(WireRequest { id, ask: DriverRequest::Cancel }) => {
                if let Some(operation) = self.running.remove(&id) {
                    operation.abort();
                }
                Ok(())
            }
            Ok(WireRequest { id, ask }) => match self.start(id, ask) {
                Ok(()) => Ok(()),
                Err(reason) => self.refuse(id, reason).await,
            },
            Err(err) => self.refuse(id_of(line), format!("not understood: {err}")).await,
        }
    }

    fn start(&mut self, id: u64, ask: DriverRequest) -> Result<(), String> {
        if self.running.contains_key(&id) {
            return Err(format!("request {id} is under way; choose another id"));
        }
        if self.running.len() >= IN_FLIGHT_MAX {
            return Err(format!("{IN_FLIGHT_MAX} requests are under way; wait for one"));
        }
        let building = self.building.clone();
        let operation = async move {
            match perform(&building, ask).await {
                Ok(answer) => ServerLine::Done { id, answer },
                Err(error) => ServerLine::Failed { id, error },
            }
        };
        self.running.insert(id, self.operations.spawn(operation.in_current_span()));
        Ok(())
    }

    async fn send_line(&mut self, line: ServerLine) -> io::Result<()> {
        if let ServerLine::Done { id, .. } | ServerLine::Failed { id, .. } = &line
            && self.running.remove(id).is_none()
        {
            // The operation finished at the moment of its cancellation.
            return Ok(());
        }
        write_line(&mut self.writer, &line).await
    }

    async fn refuse(&mut self, id: u64, reason: String) -> io::Result<()> {
        let error = DeviceError::Refused { reason };
        write_line(&mut self.writer, &ServerLine::Failed { id, error }).await
    }
}

async fn perform(
    building: &BuildingHandle,
    ask: DriverRequest,
) -> Result<DriverAnswer, DeviceError> {
    match ask {
        DriverRequest::ReadTemperature { sensor } => {
            building.read_temperature(&sensor).await.map(DriverAnswer::Reading)
        }
        DriverRequest::Navigate { robot, to } => {
            building.navigate(&robot, &to).await.map(|()| DriverAnswer::Arrived)
        }
        DriverRequest::PlaceOf { device } => {
            building.place_of(&device).await.map(DriverAnswer::Place)
        }
        DriverRequest::Measure { sensor, quantity } => {
            building.measure(&sensor, quantity).await.map(DriverAnswer::Measured)
        }
        DriverRequest::AwaitChange { sensor, quantity, known } => {
            building.await_change(&sensor, quantity, known).await.map(DriverAnswer::Measured)
        }
        DriverRequest::Battery(ask) => building.battery(ask).await.map(DriverAnswer::Battery),
        DriverRequest::Cleaning(ask) => building.cleaning(ask).await.map(DriverAnswer::Cleaning),
        DriverRequest::Camera(ask) => building.camera(ask).await.map(DriverAnswer::Camera),
        DriverRequest::Screen(ask) => building.screen(ask).await.map(DriverAnswer::Screen),
        DriverRequest::Parcel(ask) => building.parcel(ask).await.map(DriverAnswer::Parcel),
        DriverRequest::Cancel => {
            Err(DeviceError::Refused { reason: "nothing to cancel".to_owned() })
        }
    }
}

/// Returns the id of a request that is invalid otherwise; 0 if the line has no id.
fn id_of(line: &[u8]) -> u64 {
    #[derive(serde::Deserialize)]
    struct Numbered {
        id: u64,
    }
    serde_json::from_slice(line).map_or(0, |Numbered { id }| id)
}
