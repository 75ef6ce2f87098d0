//! Ports that pages are served at.

use crate::Error;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};

/// Clients that a server admits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Access {
    /// Programs on this machine, which need the token to write.
    #[default]
    Local,
    /// Everybody in the network who has the token.
    Network,
}

/// A port to serve a page at, which may be taken long before there is a page.
#[derive(Debug)]
pub struct Listener {
    socket: TcpListener,
    pub(super) port: u16,
    pub(super) access: Access,
}

impl Listener {
    /// Takes a port, a free one if none is given: of the loopback alone, or of the network.
    ///
    /// # Errors
    /// When the port is not to be had.
    pub fn bind(access: Access, port: Option<u16>) -> Result<Self, Error> {
        let ip = if access == Access::Local { Ipv4Addr::LOCALHOST } else { Ipv4Addr::UNSPECIFIED };
        let address = SocketAddr::from((ip, port.unwrap_or(0)));
        let bound = || {
            let socket = TcpListener::bind(address)?;
            socket.set_nonblocking(true)?;
            Ok((socket.local_addr()?.port(), socket))
        };
        let (port, socket) = bound().map_err(|error: std::io::Error| Error::Bind {
            address: address.to_string(),
            message: match error.kind() {
                ErrorKind::AddrInUse => "expected a free port, found one where another program listens".into(),
                _ => error.to_string(),
            },
        })?;
        Ok(Self { socket, port, access })
    }

    /// The port of a run that a page follows, if one does.
    ///
    /// # Errors
    /// When the port is not to be had.
    #[cfg(feature = "command")]
    pub fn of(flag: weaver_command::LiveFlag) -> Result<Option<Self>, Error> {
        flag.live.then(|| Self::bind(Access::Local, flag.port)).transpose()
    }

    /// The same port once more.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn try_clone(&self) -> Result<Self, Error> {
        let refused = |error: std::io::Error| {
            let address = SocketAddr::from((Ipv4Addr::LOCALHOST, self.port)).to_string();
            Error::Bind { address, message: error.to_string() }
        };
        Ok(Self { socket: self.socket.try_clone().map_err(refused)?, port: self.port, access: self.access })
    }

    /// The next client, if one waits.
    pub(super) fn accept(&self) -> Option<TcpStream> {
        let (stream, _) = self.socket.accept().ok()?;
        stream.set_nonblocking(false).ok()?;
        Some(stream)
    }

    /// This machine as others in its network call it: its address, else its name.
    pub(super) fn host(&self) -> Option<String> {
        (self.access == Access::Network).then(|| address().map(|ip| ip.to_string()).or_else(name)).flatten()
    }
}

/// The address that this machine has towards the network. A datagram socket is connected to one of the addresses kept
/// for documentation, which sends nothing.
fn address() -> Option<IpAddr> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9)).ok()?;
    let ip = socket.local_addr().ok()?.ip();
    (!ip.is_loopback() && !ip.is_unspecified()).then_some(ip)
}

/// The name of this machine, where the system keeps it in a file.
fn name() -> Option<String> {
    let files = ["/proc/sys/kernel/hostname", "/etc/hostname"];
    let names = files.iter().filter_map(|file| weaver_io::read_text(file).ok());
    names.map(|name| name.trim().to_string()).find(|name| !name.is_empty())
}
