//! Requests of the command line: a Unix socket in the instance's folder, one JSON object a line. Nothing here ever
//! waits: a client that does not read loses its answers.

use jink_runtime::Instance;
use jink_runtime::request::{Answer, Request};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;

/// Clients at a time; one more is rejected.
pub const CLIENTS: usize = 4;
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
        })
    }

    /// What to sleep on.
    pub fn fds(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        let waiting = self.clients.iter().filter(|client| client.process.is_none());
        std::iter::once(self.listener.as_fd()).chain(waiting.map(|client| client.stream.as_fd()))
    }

    /// Every request that has come, with the client it came from.
    pub fn take(&mut self) -> Vec<(usize, Request)> {
        self.accept();
        let mut requests = Vec::new();
        let mut gone = Vec::new();
        for (number, client) in self.clients.iter_mut().enumerate() {
            match client.read() {
                Ok(Some(request)) => requests.push((number, request)),
                Ok(None) => {}
                Err(why) => {
                    if let Some(text) = why {
                        client.send(&refusal(text));
                    }
                    gone.push(number);
                }
            }
        }
        // From the end, so that the numbers before stay; a client with a request is never removed in the same call.
        for number in gone.into_iter().rev() {
            self.clients.remove(number);
            for (other, _) in &mut requests {
                if *other > number {
                    *other -= 1;
                }
            }
        }
        requests
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

    fn accept(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            let mut client = Client {
                stream,
                bytes: Vec::new(),
                process: None,
            };
            if self.clients.len() == CLIENTS {
                client.send(&refusal("too many requests at a time".to_owned()));
            } else if client.stream.set_nonblocking(true).is_ok() {
                self.clients.push(client);
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
    use super::Requests;
    use jink_runtime::Instance;
    use jink_runtime::request::{Answer, Request};
    use std::io::{BufRead, BufReader, Write};
    use std::os::unix::net::UnixStream;

    fn listening(test: &str) -> (Instance, Requests) {
        let instance: Instance = format!("req_{test}_{}", std::process::id()).parse().unwrap();
        std::fs::create_dir_all(instance.folder()).unwrap();
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
