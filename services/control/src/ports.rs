//! UDP ports for flights that meet nobody else's.

use crate::Problem;
use std::net::UdpSocket;
use std::sync::atomic::{AtomicU32, Ordering};

/// The ports that are looked at, below those that the kernel gives to whoever asks for any (`ip_local_port_range`, 32768 and up): such a
/// one would be somebody else's before the program that it is meant for has opened it. Tests have those from 20000 on.
const FIRST: u32 = 16_000;
const COUNT: u32 = 4_000;
/// Where processes begin to look lies so far apart: more than one of them needs.
const APART: u32 = 16;

/// UDP ports of loopback that are free now, all different.
///
/// # Errors
/// There are none.
pub fn free<const N: usize>() -> Result<[u16; N], Problem> {
    static LOOKED_AT: AtomicU32 = AtomicU32::new(0);
    let begin = std::process::id().wrapping_mul(APART);
    let mut free = (0..COUNT).filter_map(|_| {
        let next = LOOKED_AT.fetch_add(1, Ordering::Relaxed);
        let port = u16::try_from(FIRST + begin.wrapping_add(next) % COUNT).ok()?;
        UdpSocket::bind(("127.0.0.1", port)).ok().map(|_| port)
    });
    let mut ports = [0; N];
    for port in &mut ports {
        *port = free.next().ok_or_else(|| {
            Problem::Other(format!("no UDP port from {FIRST} to {} is free", FIRST + COUNT))
        })?;
    }
    Ok(ports)
}

#[cfg(test)]
mod tests {
    use super::free;
    use std::collections::BTreeSet;

    #[test]
    fn ports_differ_and_none_is_one_that_the_kernel_gives_to_others() {
        let all: BTreeSet<u16> = (0..20).flat_map(|_| free::<4>().unwrap()).collect();
        assert_eq!(all.len(), 80);
        assert!(all.iter().all(|port| (16_000..20_000).contains(port)), "{all:?}");
    }
}
