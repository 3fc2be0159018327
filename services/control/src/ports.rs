//! UDP ports for flights that meet nobody else's.

use crate::Problem;
use std::net::UdpSocket;

/// UDP ports of loopback that are free now, all different.
///
/// # Errors
/// The system gives none.
pub fn free<const N: usize>() -> Result<[u16; N], Problem> {
    // All open at once, so that they differ.
    let mut sockets = Vec::with_capacity(N);
    let mut ports = [0; N];
    for port in &mut ports {
        let socket = UdpSocket::bind(("127.0.0.1", 0)).map_err(Problem::io("UDP port"))?;
        *port = socket.local_addr().map_err(Problem::io("UDP port"))?.port();
        sockets.push(socket);
    }
    Ok(ports)
}
