//! Commands that a page follows.

use crate::Server;
use weaver_command::Console;

/// Does the work of a command; a server, if any, has its address printed before and answers meanwhile. Its port is free
/// again after that.
pub fn live<T>(server: Option<Server<'_>>, console: &mut Console<'_>, work: impl FnOnce(&mut Console<'_>) -> T) -> T {
    let Some(server) = server else { return work(console) };
    console.note(&format!("live: {}", server.address()));
    server.during(|| work(console))
}
