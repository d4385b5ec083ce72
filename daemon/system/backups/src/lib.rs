//! Archives of what must outlive a machine: configuration, keys, state and packages in one file.
//!
//! - [`write_backup`] makes an archive. It takes the place of an older one only when it is whole and
//!   on disk.
//! - [`inspect`] checks an archive from its first byte to its last, and writes nothing.
//! - [`unpack`] unpacks an archive beside the places where its parts belong, and then
//!   [`UnpackedBackup::put_in_place`] puts all of them in place by renaming, or none.
//!
//! An archive is a compressed tar file that standard tools read. The crate knows folders and files;
//! which of them belong to an ecosystem is decided by `althing backup`.

mod error;
mod manifest;
mod owners;
mod reading;
mod restoring;
mod steady;
mod writing;

#[cfg(test)]
mod tests;

pub use error::{BackupError, StuckPlace};
pub use manifest::{BACKUP_FORMAT, BackupManifest};
pub use reading::{BackupContents, inspect};
pub use restoring::{
    RestoreOptions, RestoreTarget, RestoredPlace, TargetManner, UnpackedBackup, unpack,
};
pub use writing::{BackupPart, write_backup};
