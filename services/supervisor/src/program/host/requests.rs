//! Requests of the command line: a Unix socket in the instance's folder, one JSON object a line. Nothing here ever
//! waits: a client that does not read loses its answers.

use jink_runtime::Instance;
use jink_runtime::request::{Answer, Request};
use jink_shared_types::Timestamp;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;

/// Clients at a time; one more is rejected.
pub const CLIENTS: usize = 4;
/// Where no descriptor is left for a client, the next attempt is made so much later (s): it is readable all the time.
const NO_DESCRIPTOR_S: f64 = 0.5;
/// Longest request (bytes).
const REQUEST_MAX: usize = 8 << 10;

/// One client with what it has sent so far.
struct Client {
    stream: UnixStream,
    bytes: Vec<u8>,
    /// The process whose swap it waits for.
    process: Option<usize>,
}

/// The socket and its clients.
pub struct Requests {
    listener: UnixListener,
    path: PathBuf,
    clients: Vec<Client>,
    /// Nobody is let in before.
    closed_until: Timestamp,
}

impl Requests {
    /// Listens for `instance`.
    pub fn listen(instance: &Instance) -> std::io::Result<Self> {
        let path = instance.request_socket();
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let listener = UnixListener::bind(&path)?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            path,
            clients: Vec::with_capacity(CLIENTS),
            closed_until: Timestamp::NEVER,
        })
    }

    /// What to sleep on.
    pub fn fds(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        let waiting = self.clients.iter().filter(|client| client.process.is_none());
        let is_open = jink_runtime::now() >= self.closed_until;
        let listener = is_open.then(|| self.listener.as_fd());
        listener
            .into_iter()
            .chain(waiting.map(|client| client.stream.as_fd()))
    }

    /// Every request that has come, with the client it came from.
    pub fn take(&mut self) -> Vec<(usize, Request)> {
        let mut requests = Vec::new();
        let mut number = 0;
        while number < self.clients.len() {
            number += usize::from(self.hear(number, &mut requests));
        }
        while let Some(stream) = self.accept() {
            let mut client = Client {
                stream,
                bytes: Vec::new(),
                process: None,
            };
            if self.clients.len() == CLIENTS && !self.end_one_that_asks_nothing(&mut requests) {
                client.send(&refusal("too many requests at a time".to_owned()));
            } else {
                self.clients.push(client);
                self.hear(self.clients.len() - 1, &mut requests);
            }
        }
        requests
    }

    /// Takes what client `number` asks; false if that has ended it.
    fn hear(&mut self, number: usize, requests: &mut Vec<(usize, Request)>) -> bool {
        let Some(client) = self.clients.get_mut(number) else {
            return false;
        };
        match client.read() {
            Ok(Some(request)) => requests.push((number, request)),
            Ok(None) => {}
            Err(why) => {
                if let Some(text) = why {
                    client.send(&refusal(text));
                }
                self.clients.remove(number);
                return false;
            }
        }
        true
    }

    /// Ends the client that has been there longest without asking for anything; false if there is none.
    fn end_one_that_asks_nothing(&mut self, requests: &mut [(usize, Request)]) -> bool {
        let asks = |number: usize| requests.iter().any(|(other, _)| *other == number);
        let mut clients = self.clients.iter().enumerate();
        let silent = clients.position(|(number, client)| client.process.is_none() && !asks(number));
        let Some(silent) = silent else { return false };
        self.clients.remove(silent);
        for (other, _) in requests {
            *other -= usize::from(*other > silent);
        }
        true
    }

    /// Client `number` waits for the swap of `process`.
    pub fn wait_for(&mut self, number: usize, process: usize) {
        if let Some(client) = self.clients.get_mut(number) {
            client.process = Some(process);
        }
    }

    /// Answers client `number` and ends its connection.
    pub fn conclude(&mut self, number: usize, answer: &Answer) {
        if let Some(client) = self.clients.get_mut(number) {
            client.send(answer);
            client.process = None;
            // It closes its end when it has read the last answer; until then its requests are ignored.
        }
    }

    /// Sends `answer` to every client that waits for `process`.
    pub fn notify(&mut self, process: usize, answer: &Answer) {
        for client in &mut self.clients {
            if client.process == Some(process) {
                client.send(answer);
                if answer.last {
                    client.process = None;
                }
            }
        }
    }

    /// Removes the socket.
    pub fn close(&self) {
        let _ = std::fs::remove_file(&self.path);
    }

    /// The next client. Where there is no descriptor for it, it waits, and the supervisor does not.
    fn accept(&mut self) -> Option<UnixStream> {
        let now = jink_runtime::now();
        if now < self.closed_until {
            return None;
        }
        match self.listener.accept() {
            Ok((stream, _)) => stream.set_nonblocking(true).is_ok().then_some(stream),
            Err(error) => {
                if error.kind() != ErrorKind::WouldBlock {
                    tracing::warn!("a request cannot be taken: {error}");
                    self.closed_until = now.plus_seconds(NO_DESCRIPTOR_S);
                }
                None
            }
        }
    }
}

/// A negative answer.
pub fn refusal(text: String) -> Answer {
    Answer {
        text,
        last: true,
        good: false,
    }
}

impl Client {
    /// A whole request, or `None`; an error ends the client, with a text if it still reads.
    fn read(&mut self) -> Result<Option<Request>, Option<String>> {
        let mut chunk = [0; 1024];
        loop {
            match self.stream.read(&mut chunk) {
                Ok(0) => return Err(None),
                Ok(length) => self.bytes.extend_from_slice(&chunk[..length]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(None),
            }
            if self.bytes.len() > REQUEST_MAX {
                return Err(Some(format!("a request has at most {REQUEST_MAX} bytes")));
            }
        }
        let Some(end) = self.bytes.iter().position(|byte| *byte == b'\n') else {
            return Ok(None);
        };
        let line: Vec<u8> = self.bytes.drain(..=end).collect();
        serde_json::from_slice(&line)
            .map(Some)
            .map_err(|error| Some(format!("not understood: {error}")))
    }

    fn send(&mut self, answer: &Answer) {
        let Ok(mut line) = serde_json::to_vec(answer) else {
            return;
        };
        line.push(b'\n');
        // A client that does not read loses the answer.
        let _ = self.stream.write(&line);
    }
}

#[cfg(test)]
mod tests {
    use super::{CLIENTS, Requests};
    use jink_runtime::Instance;
    use jink_runtime::request::{Answer, Request};
    use std::io::{BufRead, BufReader, Read, Write};
    use std::os::unix::net::UnixStream;

    /// Tells the test that it is the process that has no descriptor.
    const CHILD: &str = "JINK_TEST_WITHOUT_A_DESCRIPTOR";

    fn listening(test: &str) -> (Instance, Requests) {
        let instance: Instance = format!("req_{test}_{}", std::process::id()).parse().unwrap();
        instance.make_folder().unwrap();
        let requests = Requests::listen(&instance).unwrap();
        (instance, requests)
    }

    fn wait_for(requests: &mut Requests) -> Vec<(usize, Request)> {
        loop {
            let taken = requests.take();
            if !taken.is_empty() {
                return taken;
            }
            std::thread::yield_now();
        }
    }

    #[test]
    fn a_request_is_taken_whole_and_answered_to_its_end() {
        let (instance, mut requests) = listening("whole");
        let mut client = UnixStream::connect(instance.request_socket()).unwrap();
        client.write_all(b"{\"restart\":{\"pro").unwrap();
        assert!(requests.take().is_empty(), "half a request is none");
        client.write_all(b"cess\":\"planner\"}}\n").unwrap();
        let taken = wait_for(&mut requests);
        let process = "planner".to_owned();
        assert_eq!(taken, [(0, Request::Restart { process })]);
        requests.wait_for(0, 4);
        for (text, last) in [("first", false), ("last", true)] {
            let text = text.to_owned();
            let good = true;
            requests.notify(4, &Answer { text, last, good });
        }
        let mut lines = BufReader::new(client).lines();
        for wanted in ["first", "last"] {
            let answer: Answer = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
            assert_eq!(answer.text, wanted);
        }
        std::fs::remove_dir_all(instance.folder()).unwrap();
    }

    #[test]
    fn clients_that_ask_nothing_keep_nobody_from_asking() {
        let (instance, mut requests) = listening("idle");
        let connect = || UnixStream::connect(instance.request_socket()).unwrap();
        let mut waiting = connect();
        waiting
            .write_all(b"{\"swap\":{\"process\":\"planner\",\"dry_run\":true}}\n")
            .unwrap();
        let taken = wait_for(&mut requests);
        requests.wait_for(taken[0].0, 4);
        let mut idle: Vec<_> = (0..2 * CLIENTS)
            .map(|_| {
                let client = connect();
                assert!(requests.take().is_empty());
                client
            })
            .collect();
        let mut client = connect();
        client
            .write_all(b"{\"stop\":{\"process\":\"planner\"}}\n")
            .unwrap();
        let process = "planner".to_owned();
        let taken = wait_for(&mut requests);
        assert_eq!(taken, [(CLIENTS - 1, Request::Stop { process })]);
        // Neither the one that waits nor the one that has come last was ended for it.
        let text = String::new();
        let (last, good) = (true, true);
        requests.notify(4, &Answer { text, last, good });
        assert!(BufReader::new(waiting).lines().next().unwrap().is_ok());
        assert_eq!(idle[0].read(&mut [0]).unwrap(), 0, "the first idle one is ended");
        let newest = idle.last_mut().unwrap();
        newest.set_nonblocking(true).unwrap();
        assert!(newest.read(&mut [0]).is_err(), "the newest is not");
        std::fs::remove_dir_all(instance.folder()).unwrap();
    }

    /// Not a test: without a descriptor, in a process of its own.
    #[test]
    fn child_without_a_descriptor() {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        if std::env::var_os(CHILD).is_none() {
            return;
        }
        let (instance, mut requests) = listening("no_fd");
        let mut client = UnixStream::connect(instance.request_socket()).unwrap();
        client
            .write_all(b"{\"stop\":{\"process\":\"planner\"}}\n")
            .unwrap();
        let before = getrlimit(Resource::Nofile);
        let none = Rlimit {
            current: Some(0),
            ..before
        };
        setrlimit(Resource::Nofile, none).unwrap();
        assert!(requests.take().is_empty());
        assert_eq!(
            requests.fds().count(),
            0,
            "nothing to be woken by again and again"
        );
        setrlimit(Resource::Nofile, before).unwrap();
        let process = "planner".to_owned();
        assert_eq!(wait_for(&mut requests), [(0, Request::Stop { process })]);
        std::fs::remove_dir_all(instance.folder()).unwrap();
    }

    #[test]
    fn a_client_for_whom_there_is_no_descriptor_waits_and_nobody_spins() {
        let child = std::process::Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "program::host::requests::tests::child_without_a_descriptor",
            ])
            .env(CHILD, "")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&child.stdout).into_owned();
        assert!(child.status.success() && said.contains("1 passed"), "{said}");
    }

    #[test]
    fn nonsense_is_rejected_and_endless_nonsense_is_cut_off() {
        let (instance, mut requests) = listening("nonsense");
        for nonsense in [b"hello\n".to_vec(), vec![b'x'; 9_000]] {
            let mut client = UnixStream::connect(instance.request_socket()).unwrap();
            client.write_all(&nonsense).unwrap();
            let mut line = String::new();
            client.set_nonblocking(true).unwrap();
            let mut reader = BufReader::new(client);
            while line.is_empty() {
                assert!(requests.take().is_empty());
                let _ = reader.read_line(&mut line);
            }
            let answer: Answer = serde_json::from_str(&line).unwrap();
            assert!(answer.last && !answer.good, "{answer:?}");
        }
        std::fs::remove_dir_all(instance.folder()).unwrap();
    }
}
