//! A program that shows media on a television which is turned on for them, and off after them.

use crate::cec::{CecPlayer, CecSettings};
use crate::content::Content;
use crate::player::{Player, PlayerTrouble};

/// A program, and the television of its machine, if the config names one. A medium counts as shown
/// only if the program shows it and the television shows the machine.
pub(crate) struct WithTelevision<P> {
    player: P,
    television: Option<CecPlayer>,
}

impl<P: Player> Player for WithTelevision<P> {
    type Settings = (P::Settings, Option<CecSettings>);

    async fn start((settings, television): &Self::Settings) -> Result<Self, String> {
        let television = match television {
            Some(television) => Some(CecPlayer::start(television).await?),
            None => None,
        };
        Ok(WithTelevision { player: P::start(settings).await?, television })
    }

    async fn show(&mut self, content: Option<&Content>) -> Result<(), PlayerTrouble> {
        // The program shows the medium when the television comes on, and until it goes off.
        self.player.show(content).await?;
        match &mut self.television {
            Some(television) => television.show(content).await,
            None => Ok(()),
        }
    }

    async fn check(&mut self) -> Result<(), PlayerTrouble> {
        self.player.check().await?;
        match &mut self.television {
            Some(television) => television.check().await,
            None => Ok(()),
        }
    }

    async fn failed(&mut self) -> String {
        let Some(television) = &mut self.television else { return self.player.failed().await };
        tokio::select! {
            biased;
            reason = self.player.failed() => reason,
            reason = television.failed() => reason,
        }
    }

    async fn end(self) {
        if let Some(television) = self.television {
            television.end().await;
        }
        self.player.end().await;
    }
}
