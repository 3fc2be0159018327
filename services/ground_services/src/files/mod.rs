//! A read-only file server inside MAVLink, for the files that say what our parameters mean.
//!
//! | asked | answered |
//! |---|---|
//! | OpenFileRO, ReadFile, BurstReadFile, TerminateSession, ResetSessions, ListDirectory, CalcFileCRC32 | done |
//! | whatever would write | NAK, FileProtected |
//! | anything else | NAK, UnknownCommand |
//!
//! Whoever receives no answer asks again with the same number: the last answer to each client is kept and said again,
//! so that nothing is done twice. Pieces of a burst leave at [`PACE_HZ`], in turn for all clients, and a burst ends
//! after [`BURST_PIECES`]: a client that has lost some asks for them before it goes on. A session that is not used for
//! [`SESSION_S`] is over. Session numbers are not used again soon, so a late copy of an old request ends nobody's session;
//! a client that names session 0, which nobody has, means the one it has used last.

mod crc;
mod metadata;
mod packet;

pub use crc::crc32;
pub use metadata::GENERAL_URI;
pub use packet::Payload;

use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::params::ParamSet;
use packet::{ACK, DATA, Nak, Packet, op};

/// Pieces of bursts per second (Hz). A full one is a frame of 266 bytes: a quarter of a line of 57,600 baud, which has
/// setpoints to carry; the parameters' file takes five seconds.
pub const PACE_HZ: f64 = 5.0;
/// Pieces of a burst.
const BURST_PIECES: u32 = 16;
/// Clients that may read at the same time.
const SESSIONS: usize = 4;
/// A session without a request and without a burst is over after this time (s): clients repeat themselves after one.
const SESSION_S: f64 = 10.0;
/// Number of the first session. Zero is never given out: MAVSDK names it whatever number it was given, and means the session it
/// has opened last.
const FIRST_ID: u8 = 1;
/// An answer is said again if the same request comes within this time (s); later it is a new one.
const REPEAT_S: f64 = 3.0;

/// Who asks: system and component.
type Peer = (u8, u8);

#[derive(Clone, Debug)]
struct File {
    name: &'static str,
    bytes: Vec<u8>,
}

#[derive(Clone, Copy, Debug)]
struct Burst {
    /// The request, with the number and the offset of the next piece.
    next: Packet,
    pieces_left: u32,
}

#[derive(Clone, Copy, Debug)]
struct Session {
    id: u8,
    peer: Peer,
    file: usize,
    received: Timestamp,
    burst: Option<Burst>,
}

#[derive(Clone, Copy, Debug)]
struct Said {
    peer: Peer,
    request: Payload,
    answer: Payload,
    time: Timestamp,
}

/// The server.
#[derive(Clone, Debug)]
pub struct FileServer {
    files: [File; 2],
    sessions: [Option<Session>; SESSIONS],
    said: [Option<Said>; SESSIONS],
    next_id: u8,
    /// Whose turn it is.
    turn: usize,
    pace: Ticker,
}

impl Default for FileServer {
    fn default() -> Self {
        Self::of(&ParamSet::default())
    }
}

impl FileServer {
    /// With the files that describe the rows of `params`.
    pub fn of(params: &ParamSet) -> Self {
        let parameters = metadata::parameters(params);
        Self {
            files: [
                File {
                    name: metadata::GENERAL,
                    bytes: metadata::general(&parameters),
                },
                File {
                    name: metadata::PARAMETERS,
                    bytes: parameters,
                },
            ],
            sessions: [None; SESSIONS],
            said: [None; SESSIONS],
            next_id: FIRST_ID,
            turn: 0,
            pace: Ticker::new(PACE_HZ),
        }
    }

    /// The checksum of the general file.
    pub fn general_crc(&self) -> u32 {
        crc32(&self.files[0].bytes)
    }

    /// Takes one request at `now`; answers unless the answer is a burst, whose pieces come from [`Self::next`].
    pub fn take(&mut self, now: Timestamp, peer: Peer, payload: &Payload) -> Option<Payload> {
        let request = Packet::of(payload);
        if matches!(request.opcode, ACK | packet::NAK) {
            return None; // An answer is nothing to be answered: two servers would never stop.
        }
        if request.opcode != op::BURST
            && let Some(again) = self.said_before(now, peer, payload)
        {
            return Some(again);
        }
        let answer = match self.serve(now, peer, &request) {
            Ok(answer) => answer?,
            Err(reason) => request.refusal(reason),
        };
        let answer = answer.to_payload();
        self.remember(Said {
            peer,
            request: *payload,
            answer,
            time: now,
        });
        Some(answer)
    }

    /// The next piece of a burst that is due, and for whom.
    pub fn next(&mut self, now: Timestamp) -> Option<(Peer, Payload)> {
        if now < self.pace.due() {
            return None;
        }
        for step in 1..=SESSIONS {
            let slot = (self.turn + step) % SESSIONS;
            if let Some(session) = &mut self.sessions[slot]
                && let Some(burst) = &mut session.burst
            {
                let piece = piece(&self.files[session.file].bytes, burst);
                session.received = now;
                if piece.opcode != ACK || piece.burst_complete {
                    session.burst = None;
                }
                self.turn = slot;
                self.pace.restart(now);
                return Some((session.peer, piece.to_payload()));
            }
        }
        None
    }

    /// When the next piece is due; `None` if nobody waits for one.
    pub fn next_wake(&self) -> Option<Timestamp> {
        let is_busy = self
            .sessions
            .iter()
            .flatten()
            .any(|session| session.burst.is_some());
        is_busy.then(|| self.pace.due())
    }

    fn said_before(&self, now: Timestamp, peer: Peer, payload: &Payload) -> Option<Payload> {
        let said = self.said.iter().flatten().find(|said| said.peer == peer)?;
        let is_same = said.request == *payload && now.seconds_since(said.time) < REPEAT_S;
        is_same.then_some(said.answer)
    }

    /// In the place of the last answer to the same client, else in a free place, else in that of the oldest.
    fn remember(&mut self, said: Said) {
        let of = |slot: &Option<Said>| match slot {
            Some(old) if old.peer == said.peer => (0, Timestamp::NEVER),
            None => (1, Timestamp::NEVER),
            Some(old) => (2, old.time),
        };
        if let Some(slot) = self.said.iter_mut().min_by_key(|slot| of(slot)) {
            *slot = Some(said);
        }
    }

    /// `Ok(None)`: the answer is a burst.
    fn serve(&mut self, now: Timestamp, peer: Peer, request: &Packet) -> Result<Option<Packet>, Nak> {
        let done = request.answer(ACK);
        match request.opcode {
            op::TERMINATE => {
                let slot = self.slot(peer, request.session)?;
                self.sessions[slot] = None;
                Ok(Some(done))
            }
            op::RESET => {
                for slot in &mut self.sessions {
                    if slot.is_some_and(|session| session.peer == peer) {
                        *slot = None;
                    }
                }
                Ok(Some(done))
            }
            op::LIST => self.list(request).map(Some),
            op::OPEN => {
                let file = self.find(request)?;
                let id = self.open(now, peer, file)?;
                let size = self.files[file].bytes.len() as u32;
                Ok(Some(Packet { session: id, ..done }.with(&size.to_le_bytes())))
            }
            op::READ => {
                let bytes = &self.files[self.used(now, peer, request.session)?.file].bytes;
                let piece = cut(bytes, request.offset, request.piece()).ok_or(Nak::EndOfFile)?;
                Ok(Some(done.with(piece)))
            }
            op::BURST => {
                self.used(now, peer, request.session)?.burst = Some(Burst {
                    next: Packet {
                        seq: request.seq.wrapping_add(1),
                        ..*request
                    },
                    pieces_left: BURST_PIECES,
                });
                Ok(None)
            }
            op::CRC => {
                let file = self.find(request)?;
                let crc = crc32(&self.files[file].bytes);
                Ok(Some(done.with(&crc.to_le_bytes())))
            }
            writing if op::WRITING.contains(&writing) => Err(Nak::FileProtected),
            _ => Err(Nak::UnknownCommand),
        }
    }

    /// Entries of the only folder from the one whose number is asked for: as many as fit, each ended by a zero.
    fn list(&self, request: &Packet) -> Result<Packet, Nak> {
        match request.path().ok_or(Nak::InvalidDataSize)? {
            "" | "." => {}
            _ => return Err(Nak::FileNotFound),
        }
        let mut data = [0; DATA];
        let mut used = 0;
        let first = usize::try_from(request.offset).unwrap_or(usize::MAX);
        for file in self.files.iter().skip(first) {
            let mut rest = &mut data[used..];
            let room = rest.len();
            let entry = format_args!("F{}\t{}\0", file.name, file.bytes.len());
            if std::io::Write::write_fmt(&mut rest, entry).is_err() {
                break;
            }
            used += room - rest.len();
        }
        match used {
            0 => Err(Nak::EndOfFile),
            _ => Ok(request.answer(ACK).with(&data[..used])),
        }
    }

    fn find(&self, request: &Packet) -> Result<usize, Nak> {
        let path = request.path().ok_or(Nak::InvalidDataSize)?;
        let found = self.files.iter().position(|file| file.name == path);
        found.ok_or(Nak::FileNotFound)
    }

    /// A new session in a free place, or in that of one that is over.
    fn open(&mut self, now: Timestamp, peer: Peer, file: usize) -> Result<u8, Nak> {
        let is_over = |session: &Session| now.seconds_since(session.received) > SESSION_S;
        let free = self
            .sessions
            .iter_mut()
            .find(|slot| slot.as_ref().is_none_or(is_over));
        let slot = free.ok_or(Nak::NoSessionsAvailable)?;
        let id = self.next_id;
        self.next_id = self.next_id.checked_add(1).unwrap_or(FIRST_ID);
        *slot = Some(Session {
            id,
            peer,
            file,
            received: now,
            burst: None,
        });
        Ok(id)
    }

    /// Where the session of `peer` with this number is; with no number, the one it has used last.
    fn slot(&self, peer: Peer, id: u8) -> Result<usize, Nak> {
        let is_it = |session: &&Session| session.peer == peer && (session.id == id || id < FIRST_ID);
        let places = self.sessions.iter().enumerate();
        let slot = places
            .filter_map(|(slot, session)| Some((slot, session.as_ref().filter(is_it)?)))
            .max_by_key(|(_, session)| (session.received, session.id));
        slot.map(|(slot, _)| slot).ok_or(Nak::InvalidSession)
    }

    /// The session, whose burst ends with every other request.
    fn used(&mut self, now: Timestamp, peer: Peer, id: u8) -> Result<&mut Session, Nak> {
        let slot = self.slot(peer, id)?;
        let session = self.sessions[slot].as_mut().ok_or(Nak::InvalidSession)?;
        session.received = now;
        session.burst = None;
        Ok(session)
    }
}

/// The next piece of `burst`, which then stands behind it; behind the end a refusal.
fn piece(bytes: &[u8], burst: &mut Burst) -> Packet {
    let next = burst.next;
    // `answer` counts on from the request, the number here is that of the piece itself.
    let numbered = Packet {
        seq: next.seq.wrapping_sub(1),
        ..next
    };
    let Some(piece) = cut(bytes, next.offset, next.piece()) else {
        return numbered.refusal(Nak::EndOfFile);
    };
    let end = next.offset.saturating_add(piece.len() as u32);
    burst.pieces_left = burst.pieces_left.saturating_sub(1);
    burst.next.seq = next.seq.wrapping_add(1);
    burst.next.offset = end;
    Packet {
        burst_complete: burst.pieces_left == 0 || end as usize >= bytes.len(),
        ..numbered.answer(ACK).with(piece)
    }
}

/// Up to `len` bytes from `offset`; `None` behind the end.
fn cut(bytes: &[u8], offset: u32, len: usize) -> Option<&[u8]> {
    let rest = bytes.get(usize::try_from(offset).ok()?..)?;
    (!rest.is_empty()).then(|| &rest[..rest.len().min(len)])
}

#[cfg(test)]
mod tests;
