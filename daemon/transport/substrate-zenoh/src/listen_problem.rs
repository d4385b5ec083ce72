//! Explanation of why a daemon cannot listen on an endpoint: names the endpoint, the kernel's
//! error, and the process that has the port. Zenoh's own error names none of them.

use std::fs;
use std::io::ErrorKind;
use std::net::{TcpListener, ToSocketAddrs as _};
use std::os::unix::fs::MetadataExt as _;

use crate::endpoint;

/// The state of a listening socket, as `/proc/net/tcp` writes it.
const LISTENS: &str = "0A";

/// Maximum length of a command line in a report, in characters; the rest is cut off.
const COMMAND_CHARS_MAX: usize = 120;

/// Returns the reason why the daemon cannot listen on one of the endpoints; `None` if it can listen
/// on all of them. The text completes “failed to …”.
pub(crate) fn obstacle(listen: &[String]) -> Option<String> {
    listen.iter().find_map(|endpoint| {
        let (host, port) = endpoint::host_and_port(endpoint)?;
        let addresses = match (host.as_str(), port).to_socket_addrs() {
            Ok(addresses) => addresses,
            Err(_) => {
                return Some(format!(
                    "listen on `{endpoint}`: there is no host `{host}`; write an address of this \
                     machine, or `[::]` for all of them"
                ));
            }
        };
        let errors = addresses.filter_map(|address| TcpListener::bind(address).err());
        errors.map(|error| explain(endpoint, &host, port, error.kind(), &error.to_string())).next()
    })
}

fn explain(endpoint: &str, host: &str, port: u16, kind: ErrorKind, error: &str) -> String {
    match kind {
        ErrorKind::AddrInUse => {
            let by = holder(port).map_or_else(String::new, |by| format!(" by {by}"));
            let other = endpoint.replacen(&format!(":{port}"), &format!(":{}", next(port)), 1);
            format!(
                "listen on `{endpoint}`: port {port} is taken{by}; end that, or give this daemon \
                 another: ALTHING_ZENOH__LISTEN__ENDPOINTS='[\"{other}\"]' before its command"
            )
        }
        ErrorKind::AddrNotAvailable => format!(
            "listen on `{endpoint}`: `{host}` is no address of this machine; write one that `ip \
             address` shows, or `[::]` for all of them"
        ),
        ErrorKind::PermissionDenied => format!(
            "listen on `{endpoint}`: only root may listen on port {port}; take one from 1024 on"
        ),
        _ => format!("listen on `{endpoint}`: {error}"),
    }
}

fn next(port: u16) -> u16 {
    port.checked_add(1).unwrap_or(port - 1)
}

/// Returns a description of the process that listens on a port of this machine; `None` if there is
/// no such process. If the present user may not see the process, the description names only the
/// user of the process.
fn holder(port: u16) -> Option<String> {
    let tables = ["/proc/net/tcp", "/proc/net/tcp6"];
    let listener = tables.iter().find_map(|table| listener(&fs::read_to_string(table).ok()?, port));
    let (user, inode) = listener?;
    match process_with(&format!("socket:[{inode}]")) {
        Some((process, command)) => Some(format!("process {process} (`{command}`)")),
        None => Some(format!("a process of user {user}")),
    }
}

/// Returns the id of the user and the inode of the socket that listens on a port, according to
/// `table` (the text of `/proc/net/tcp`); `None` if no socket listens on that port.
fn listener(table: &str, port: u16) -> Option<(String, String)> {
    table.lines().skip(1).find_map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let at = u16::from_str_radix(fields.get(1)?.rsplit(':').next()?, 16).ok()?;
        let listens = *fields.get(3)? == LISTENS && at == port;
        listens.then(|| Some(((*fields.get(7)?).to_owned(), (*fields.get(9)?).to_owned())))?
    })
}

/// Returns the identifier and the command line of the process that has the file `file` open; `None`
/// if no process that this user can see has the file open.
fn process_with(file: &str) -> Option<(u32, String)> {
    let own = fs::metadata("/proc/self").ok()?.uid();
    for entry in fs::read_dir("/proc").ok()?.flatten() {
        let Some(process) = entry.file_name().to_str().and_then(|name| name.parse().ok()) else {
            continue;
        };
        // A user other than root cannot read the open files of other users' processes.
        if own != 0 && entry.metadata().is_ok_and(|about| about.uid() != own) {
            continue;
        }
        let open = fs::read_dir(entry.path().join("fd")).into_iter().flatten().flatten();
        let targets = open.filter_map(|each| fs::read_link(each.path()).ok());
        if targets.into_iter().any(|target| target.to_string_lossy() == file) {
            let command = fs::read(entry.path().join("cmdline")).unwrap_or_default();
            let words = String::from_utf8_lossy(&command).trim_end_matches('\0').replace('\0', " ");
            return Some((process, words.chars().take(COMMAND_CHARS_MAX).collect()));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_taken_port_is_reported_with_its_process() {
        let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = taken.local_addr().expect("an address").port();
        let endpoints = ["unixsock-stream//run/a.sock".to_owned(), format!("tcp/127.0.0.1:{port}")];
        let told = obstacle(&endpoints).expect("it is taken");
        let who = format!("port {port} is taken by process {} (`", std::process::id());
        assert!(told.contains(&who) && told.contains(&endpoints[1]), "{told}");
        drop(taken);
        assert_eq!(obstacle(&endpoints), None);
    }

    #[test]
    fn an_address_of_another_machine_is_reported() {
        let told = obstacle(&["tls/192.0.2.7:7461".to_owned()]).expect("a test address");
        assert!(told.contains("`192.0.2.7` is no address of this machine"), "{told}");
        let told = obstacle(&["tls/nobody.invalid:7461".to_owned()]).expect("no host");
        assert!(told.contains("there is no host `nobody.invalid`"), "{told}");
    }

    #[test]
    fn tables_of_the_kernel_are_read() {
        let table = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n\
             0: 0100007F:1D25 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1000        0 4242 1 x\n\
             1: 0100007F:1D26 0100007F:1D25 01 00000000:00000000 00:00000000 00000000  1000        0 4243 1 x\n";
        assert_eq!(listener(table, 7461), Some(("1000".to_owned(), "4242".to_owned())));
        assert_eq!(listener(table, 7462), None, "it is connected, and does not listen");
    }
}
