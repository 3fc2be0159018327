//! Which link a message goes to: MAVLink's rules of routing over a table learned from traffic.
//!
//! | message | goes to |
//! |---|---|
//! | without a target, or to system 0 | every other link |
//! | to a system, component 0 | the links on which that system was received |
//! | to a system and component | the links on which exactly that one was received |
//! | SETUP_SIGNING | nowhere: a key never travels |
//!
//! No message returns to the link it came from, and a message from one of our own ids goes nowhere: it went round a
//! loop. When the clock of a system goes backwards, twice in a row, it has started anew, perhaps elsewhere: its routes are forgotten.
//!
//! Source: MAVLink guide, "Routing".

use crate::message::COMPONENT_AUTOPILOT;
use jink_shared_types::link::LINKS;
use mavlink::MessageData;
use mavlink::dialect::SETUP_SIGNING_DATA;

/// Senders remembered: a dozen vehicles with all their components. The one not received for longest is replaced.
const ROUTES: usize = 64;
/// A clock that is behind by less than this was overtaken on the way, not started anew (ms).
const OVERTAKEN_MS: u32 = 1000;

/// Some of the links.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkSet(u8);

impl LinkSet {
    /// The first `count` links.
    pub fn first(count: usize) -> Self {
        Self((0..count.min(LINKS)).fold(0, |set, link| set | 1 << link))
    }

    /// With link `index`.
    #[must_use]
    pub fn with(self, index: u8) -> Self {
        Self(self.0 | bit(index))
    }

    /// Without link `index`.
    #[must_use]
    pub fn without(self, index: u8) -> Self {
        Self(self.0 & !bit(index))
    }

    /// Whether link `index` is in it.
    pub fn contains(self, index: u8) -> bool {
        self.0 & bit(index) != 0
    }

    /// Whether no link is in it.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }
}

fn bit(index: u8) -> u8 {
    1u8.checked_shl(u32::from(index)).unwrap_or(0)
}

/// The addressee of a message; zeros mean all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Target {
    /// System.
    pub system_id: u32,
    /// Component of it.
    pub component_id: u8,
}

/// The sender of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// System.
    pub system_id: u32,
    /// Component of it.
    pub component_id: u8,
}

/// Who we are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OwnIds {
    /// Our system; `None` before the autopilot was received.
    pub system_id: Option<u8>,
    /// Our components; zeros stand for none.
    pub components: [u8; 2],
}

impl OwnIds {
    fn is_our_component(&self, component_id: u8) -> bool {
        component_id != 0 && self.components.contains(&component_id)
    }

    /// Whether a message of `sender` is our own and came back.
    pub fn sent(&self, sender: Sender) -> bool {
        self.system_id.map(u32::from) == Some(sender.system_id) && self.is_our_component(sender.component_id)
    }

    /// Whether `sender` is our autopilot; before that was received any autopilot may be it.
    pub fn is_autopilot(&self, sender: Sender) -> bool {
        let is_our_system = self
            .system_id
            .is_none_or(|system_id| u32::from(system_id) == sender.system_id);
        is_our_system && sender.component_id == COMPONENT_AUTOPILOT
    }

    /// Whether a message to `target` is handled here: to all, to our system, to one of our components. Before the
    /// autopilot was received everything is, because our system id is not known yet.
    pub fn accepts(&self, target: Target) -> bool {
        let Some(system_id) = self.system_id else {
            return true;
        };
        let our_system = target.system_id == 0 || target.system_id == u32::from(system_id);
        our_system && (target.component_id == 0 || self.is_our_component(target.component_id))
    }
}

#[derive(Clone, Copy, Debug)]
struct Route {
    sender: Sender,
    links: LinkSet,
    boot_ms: u32,
    /// A time since boot that was less than that: if the next one goes on from it, the system has started anew.
    anew_ms: Option<u32>,
    last_received: u64,
}

/// The table.
#[derive(Clone, Debug)]
pub struct Router {
    all: LinkSet,
    routes: Vec<Route>,
    count: u64,
}

impl Router {
    /// An empty table for `links` links.
    pub fn new(links: usize) -> Self {
        Self {
            all: LinkSet::first(links),
            routes: Vec::with_capacity(ROUTES),
            count: 0,
        }
    }

    /// Records that `sender` was received on link `origin`; broadcast addresses never send.
    pub fn learn(&mut self, origin: u8, sender: Sender) {
        if sender.system_id == 0 || sender.component_id == 0 {
            return;
        }
        self.count += 1;
        if let Some(known) = self.routes.iter_mut().find(|route| route.sender == sender) {
            known.links = known.links.with(origin);
            known.last_received = self.count;
            return;
        }
        let route = Route {
            sender,
            links: LinkSet::default().with(origin),
            boot_ms: 0,
            anew_ms: None,
            last_received: self.count,
        };
        if self.routes.len() < ROUTES {
            self.routes.push(route);
        } else if let Some(oldest) = self.routes.iter_mut().min_by_key(|known| known.last_received) {
            *oldest = route;
        }
    }

    /// Processes the time since boot of `sender` (SYSTEM_TIME), received on link `origin`: if it is less than before, twice in a
    /// row, the system has restarted and its routes start with this link. A single one may be late, or of somebody else.
    pub fn on_system_time(&mut self, origin: u8, sender: Sender, boot_ms: u32) {
        let Some(route) = self.routes.iter_mut().find(|route| route.sender == sender) else {
            return;
        };
        if boot_ms.saturating_add(OVERTAKEN_MS) >= route.boot_ms {
            route.boot_ms = boot_ms;
            route.anew_ms = None;
            return;
        }
        if route
            .anew_ms
            .replace(boot_ms)
            .is_none_or(|first_ms| boot_ms <= first_ms)
        {
            return;
        }
        self.routes
            .retain(|route| route.sender.system_id != sender.system_id);
        self.learn(origin, sender);
        if let Some(route) = self.routes.iter_mut().find(|route| route.sender == sender) {
            route.boot_ms = boot_ms;
        }
    }

    /// The links to which a message received on link `origin` is forwarded.
    pub fn forwards_to(&self, origin: u8, message_id: u32, target: Target) -> LinkSet {
        if message_id == SETUP_SIGNING_DATA::ID {
            return LinkSet::default();
        }
        self.links_to(target).without(origin)
    }

    /// The links over which `target` can be reached.
    pub fn links_to(&self, target: Target) -> LinkSet {
        if target.system_id == 0 {
            return self.all;
        }
        let is_meant = |sender: Sender| {
            sender.system_id == target.system_id
                && (target.component_id == 0 || sender.component_id == target.component_id)
        };
        self.routes
            .iter()
            .filter(|route| is_meant(route.sender))
            .fold(LinkSet::default(), |set, route| LinkSet(set.0 | route.links.0))
    }
}

#[cfg(test)]
mod tests {
    use super::{LinkSet, OwnIds, ROUTES, Router, Sender, Target};
    use proptest::prelude::*;

    fn sender(system_id: u32, component_id: u8) -> Sender {
        Sender {
            system_id,
            component_id,
        }
    }

    fn to(system_id: u32, component_id: u8) -> Target {
        Target {
            system_id,
            component_id,
        }
    }

    fn set(links: &[u8]) -> LinkSet {
        links.iter().fold(LinkSet::default(), |set, link| set.with(*link))
    }

    /// An autopilot on link 0, a station and a camera of our system on link 1, another station on link 2.
    fn learned() -> Router {
        let mut router = Router::new(3);
        for (link, from) in [
            (0, sender(1, 1)),
            (1, sender(255, 190)),
            (1, sender(1, 100)),
            (2, sender(254, 190)),
        ] {
            router.learn(link, from);
        }
        router
    }

    #[test]
    fn messages_go_where_they_are_meant_to_and_nowhere_else() {
        let router = learned();
        for (origin, target, links) in [
            (0, to(0, 0), &[1, 2][..]),
            (1, to(0, 0), &[0, 2]),
            (0, to(255, 190), &[1]),
            (1, to(1, 1), &[0]),
            (2, to(1, 0), &[0, 1]),
            (1, to(1, 0), &[0]),
            (1, to(1, 196), &[]),
            (0, to(77, 1), &[]),
            (1, to(255, 190), &[]),
        ] {
            assert_eq!(
                router.forwards_to(origin, 0, target),
                set(links),
                "{origin} {target:?}"
            );
        }
    }

    #[test]
    fn a_key_never_travels() {
        let router = learned();
        assert!(router.forwards_to(1, 256, to(1, 1)).is_empty());
        assert!(router.forwards_to(1, 256, to(0, 0)).is_empty());
    }

    #[test]
    fn a_system_that_has_restarted_is_only_where_it_is_received_now() {
        let mut router = learned();
        router.on_system_time(0, sender(1, 1), 60_000);
        router.on_system_time(0, sender(1, 1), 59_500);
        assert_eq!(
            router.links_to(to(1, 100)),
            set(&[1]),
            "an overtaken message is no restart"
        );
        router.on_system_time(2, sender(1, 1), 800);
        router.on_system_time(0, sender(1, 1), 60_600);
        router.on_system_time(2, sender(1, 1), 800);
        router.on_system_time(2, sender(1, 1), 800);
        assert_eq!(
            router.links_to(to(1, 0)),
            set(&[0, 1]),
            "one message is no restart, however often it comes"
        );
        router.on_system_time(2, sender(1, 1), 1_800);
        assert_eq!(router.links_to(to(1, 0)), set(&[2]));
        assert_eq!(
            router.links_to(to(255, 190)),
            set(&[1]),
            "other systems stay where they are"
        );
    }

    #[test]
    fn we_handle_what_is_for_all_for_our_system_or_for_one_of_us() {
        let us = OwnIds {
            system_id: Some(1),
            components: [196, 191],
        };
        for (target, ours) in [
            (to(0, 0), true),
            (to(1, 0), true),
            (to(1, 196), true),
            (to(1, 191), true),
            (to(0, 196), true),
            (to(1, 1), false),
            (to(255, 190), false),
            (to(2, 196), false),
        ] {
            assert_eq!(us.accepts(target), ours, "{target:?}");
        }
        assert!(us.sent(sender(1, 196)) && !us.sent(sender(1, 1)) && !us.sent(sender(2, 196)));
        let alone = OwnIds {
            components: [196, 0],
            ..us
        };
        assert!(!alone.sent(sender(1, 0)));
    }

    proptest! {
        #[test]
        fn nothing_ever_goes_back_where_it_came_from_or_to_a_link_that_is_not_there(
            links in 1..=4u8,
            traffic in proptest::collection::vec((0..4u8, 0..300u32, any::<u8>(), any::<u32>()), 0..200),
            origin in 0..4u8, system_id in 0..300u32, component_id in any::<u8>(), message_id in 0..400u32,
        ) {
            let mut router = Router::new(usize::from(links));
            for (link, system_id, component_id, boot_ms) in traffic {
                router.learn(link % links, sender(system_id, component_id));
                router.on_system_time(link % links, sender(system_id, component_id), boot_ms);
            }
            let origin = origin % links;
            let passed = router.forwards_to(origin, message_id, to(system_id, component_id));
            prop_assert!(!passed.contains(origin));
            prop_assert_eq!(passed.0 & LinkSet::first(usize::from(links)).0, passed.0);
            prop_assert!(router.routes.len() <= ROUTES);
        }

        #[test]
        fn a_sender_that_was_received_just_now_can_be_answered(
            traffic in proptest::collection::vec((0..4u8, 1..400u32, 1..=255u8), 1..300),
        ) {
            let mut router = Router::new(4);
            for (link, system_id, component_id) in traffic {
                router.learn(link, sender(system_id, component_id));
                prop_assert!(router.links_to(to(system_id, component_id)).contains(link));
            }
        }
    }
}
