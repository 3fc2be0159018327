//! UDP ports for tests: none is handed out twice while several tests run, in this process or in another.
//!
//! The kernel's own answer (bind to port 0, look, close) may be given again, to another test or to whatever program opens a socket
//! next, before the program that it is meant for has bound it. These ports lie below the range that the kernel gives out by itself
//! (`ip_local_port_range`, 32768 and up), and every process of tests has a block of them.
// A harness for tests: without ports there is nothing to test.
#![allow(clippy::expect_used)]

use std::net::{TcpListener, UdpSocket};
use std::sync::{Mutex, PoisonError};

/// Below it are the ports of the configuration (14540, 14550 and their neighbours).
const FIRST: u16 = 20_000;
/// More than one process of tests asks for; those that are asked for after that begin anew.
const BLOCK: u16 = 400;
const BLOCKS: u16 = 31;

/// Ports of this process.
#[derive(Debug)]
struct Block {
    /// The block is taken as long as somebody listens on its first port: it is free again when its process ends, however it ends.
    lock: TcpListener,
    handed_out: u16,
}

impl Block {
    fn take() -> Self {
        let first = (std::process::id() % u32::from(BLOCKS)) as u16;
        let mut blocks = (0..BLOCKS).map(|step| FIRST + (first + step) % BLOCKS * BLOCK);
        Self {
            lock: blocks
                .find_map(|port| TcpListener::bind(("127.0.0.1", port)).ok())
                .expect("a block of ports that no other process of tests has"),
            handed_out: 0,
        }
    }

    fn next(&mut self) -> u16 {
        let first = self.lock.local_addr().expect("its address").port();
        let mut ports = (0..BLOCK).map(|_| {
            self.handed_out += 1;
            first + self.handed_out % BLOCK
        });
        ports
            .find(|port| UdpSocket::bind(("127.0.0.1", *port)).is_ok())
            .expect("a UDP port")
    }
}

/// A UDP port on loopback that is free now and handed out to nobody else.
///
/// # Panics
/// If there is none.
pub fn free_udp_port() -> u16 {
    static BLOCK_OF_THIS_PROCESS: Mutex<Option<Block>> = Mutex::new(None);
    let mut block = BLOCK_OF_THIS_PROCESS
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    block.get_or_insert_with(Block::take).next()
}

/// As many of them.
///
/// # Panics
/// If there are not as many.
pub fn free_udp_ports(count: usize) -> Vec<u16> {
    (0..count).map(|_| free_udp_port()).collect()
}

#[cfg(test)]
mod tests {
    use super::{Block, free_udp_ports};
    use std::collections::BTreeSet;

    #[test]
    fn no_port_is_handed_out_twice() {
        let threads = [0; 4].map(|_| std::thread::spawn(|| free_udp_ports(50)));
        let ports: BTreeSet<u16> = threads
            .into_iter()
            .flat_map(|thread| thread.join().expect("no panic"))
            .collect();
        assert_eq!(ports.len(), 200);
        // As another process would: it gets another block.
        assert!(!ports.contains(&Block::take().next()));
    }
}
