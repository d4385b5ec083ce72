//! Drives an output line, and opens the line again after its chip was unplugged.

use std::sync::{Arc, Mutex, PoisonError};

use crate::line_watch::run_blocking;
use crate::{GpioBoard, LineError, OutputLine, OutputSettings};

/// An output line that can be made active or inactive. The line is opened at its first use, and
/// closed when all clones of this value are dropped.
#[derive(Clone)]
pub struct DrivenOutput {
    board: Arc<dyn GpioBoard>,
    output: Arc<OutputSettings>,
    open_line: Arc<Mutex<Option<Box<dyn OutputLine>>>>,
}

impl DrivenOutput {
    /// Returns an output for a line of this board, without opening the line.
    pub fn new(board: Arc<dyn GpioBoard>, output: OutputSettings) -> DrivenOutput {
        DrivenOutput { board, output: Arc::new(output), open_line: Arc::default() }
    }

    /// Returns `true` if the line is active, as read back from its chip.
    ///
    /// # Errors
    ///
    /// Returns the reason why the line cannot be used at present; the text completes “failed to …”.
    pub async fn value(&self) -> Result<bool, String> {
        self.with(|line| line.value()).await
    }

    /// Makes the line active or inactive. Returns the new state as read back from the chip: `true`
    /// if the line is active.
    ///
    /// # Errors
    ///
    /// Returns the reason why the line cannot be used at present; the text completes “failed to …”.
    pub async fn set(&self, is_active: bool) -> Result<bool, String> {
        self.with(move |line| {
            line.set(is_active)?;
            line.value()
        })
        .await
    }

    async fn with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn OutputLine) -> Result<T, LineError> + Send + 'static,
    ) -> Result<T, String> {
        let driven = self.clone();
        run_blocking(move || {
            let mut held = driven.open_line.lock().unwrap_or_else(PoisonError::into_inner);
            let line = match held.take() {
                Some(line) => line,
                None => driven.board.output(&driven.output)?,
            };
            // On an error the line is closed, so that the next use searches for it again.
            let done = work(&*line)?;
            *held = Some(line);
            Ok(done)
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MemoryBoard;

    fn driven(bench: &MemoryBoard, is_active_low: bool) -> DrivenOutput {
        let line = "relay".to_owned().try_into().expect("a name");
        DrivenOutput::new(Arc::new(bench.clone()), OutputSettings { line, is_active_low })
    }

    #[tokio::test]
    async fn a_line_is_driven_and_opening_it_switches_nothing() {
        for is_active_low in [false, true] {
            let bench = MemoryBoard::default();
            bench.plug("relay", true);
            let relay = driven(&bench, is_active_low);
            assert_eq!(relay.value().await, Ok(!is_active_low));
            assert_eq!(bench.level("relay"), Some(true), "it is as it was");
            for is_active in [false, true] {
                assert_eq!(relay.set(is_active).await, Ok(is_active));
                assert_eq!(bench.level("relay"), Some(is_active != is_active_low));
            }
            drop(relay);
            let next = driven(&bench, is_active_low);
            assert_eq!(next.value().await, Ok(true), "it is as it was left");
        }
    }

    #[tokio::test]
    async fn an_unplugged_line_is_found_again() {
        let bench = MemoryBoard::default();
        let relay = driven(&bench, false);
        assert!(relay.value().await.is_err_and(|problem| problem.starts_with("find a line named")));
        bench.plug("relay", false);
        assert_eq!(relay.set(true).await, Ok(true));
        bench.unplug("relay");
        let gone = "drive the line `relay`: No such device (os error 19)";
        assert_eq!(relay.set(false).await, Err(gone.to_owned()));
        bench.plug("relay", true);
        assert_eq!(relay.value().await, Ok(true));
    }

    #[tokio::test]
    async fn a_line_that_cannot_be_driven_is_read_back_truly() {
        let bench = MemoryBoard::default();
        bench.plug("relay", false);
        bench.fix_level("relay");
        assert_eq!(driven(&bench, false).set(true).await, Ok(false));
    }
}
