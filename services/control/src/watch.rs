//! Looking at a running system through shared memory.

use crate::Problem;
use crate::known_space::KnownSpace;
use crate::planned_speed::PlannedSpeed;
use jink_runtime::config::Foreign;
use jink_runtime::{Input, Instance, OpenError, Session};
use jink_shared_types::health::SystemStatus;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::Route;
use jink_shared_types::view::Missing;
use jink_shared_types::{Reading, Stamped, topics};

/// Who operates an instance, in the topic table: may read everything.
pub const PROGRAM: &str = topics::SPECTATOR;

/// Status and link of one instance.
pub struct Watch {
    status: Input<SystemStatus>,
    link: Input<LinkStatus>,
    session: Session,
}

impl Watch {
    /// Connects. Only to be called once the supervisor has prepared the memory.
    pub fn open(instance: &Instance) -> Result<Self, Problem> {
        let mut session = Session::open(instance, PROGRAM)?;
        // Whoever opens a topic first gives it its room: that of the process table, with the programs of others in it.
        if let Ok(foreign) = Foreign::load(&instance.run_config()) {
            session = session.with(&foreign);
        }
        Ok(Self::over(session)?)
    }

    /// Over a connection of a program that may read everything, too.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn over(session: Session) -> Result<Self, OpenError> {
        Ok(Self {
            status: session.input(topics::SYSTEM_STATUS, "")?,
            link: session.input(topics::LINK_STATUS, "")?,
            session,
        })
    }

    /// Whether the supervisor of `instance` has prepared the memory: it writes the configuration in force last.
    pub fn is_ready(instance: &Instance) -> bool {
        instance
            .run_config()
            .join(jink_runtime::config::CONFIG_FILE)
            .is_file()
    }

    /// The connection, for further topics.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The newest status, if it is fresh.
    pub fn status(&mut self) -> Option<SystemStatus> {
        match self.status.latest(jink_runtime::now()) {
            Reading::Fresh(status) => Some(*status.sample),
            Reading::Stale { .. } | Reading::Never => None,
        }
    }

    /// The newest figures of the link, however old.
    pub fn link(&mut self) -> Option<Stamped<'_, LinkStatus>> {
        self.link.latest(jink_runtime::now());
        self.link.newest()
    }

    /// Those that [`Self::link`] has found last.
    pub fn link_seen(&self) -> Option<Stamped<'_, LinkStatus>> {
        self.link.newest()
    }
}

/// What map and planner say of the sensors.
pub struct SpaceWatch {
    map: Input<LocalMap>,
    route: Input<Route>,
}

impl SpaceWatch {
    /// Connects.
    pub fn open(session: &Session) -> Result<Self, OpenError> {
        Ok(Self {
            map: session.input(topics::LOCAL_MAP, "")?,
            route: session.input(topics::ROUTE, "")?,
        })
    }

    /// What they say now; `None` while one of them says nothing.
    pub fn look(&mut self) -> Option<KnownSpace> {
        let now = jink_runtime::now();
        let unseen = self.unseen()?;
        let declarations = self.map.latest(now).fresh()?.sample.declarations;
        Some(KnownSpace::new(declarations, unseen))
    }

    /// How fast plans get and what they allow for; `None` while the planner does not know.
    pub fn speed(&mut self) -> Option<PlannedSpeed> {
        let route = self.route.latest(jink_runtime::now()).fresh()?;
        PlannedSpeed::of(route.sample)
    }

    /// The newest map, however old: a program that needs it besides takes no second place among the readers of a large topic.
    pub fn map(&mut self) -> Option<Stamped<'_, LocalMap>> {
        self.map.latest(jink_runtime::now());
        self.map.newest()
    }

    /// Hands every route that has come since to `visit`, the oldest first.
    pub fn each_route(&mut self, visit: impl FnMut(Stamped<'_, Route>)) {
        self.route.each(visit);
    }

    /// The newest route, however old.
    pub fn route(&mut self) -> Option<Stamped<'_, Route>> {
        self.route.latest(jink_runtime::now());
        self.route.newest()
    }

    /// What the planner misses; `None` while it says nothing.
    pub fn unseen(&mut self) -> Option<Missing> {
        let route = self.route.latest(jink_runtime::now()).fresh()?;
        Some(route.sample.unseen.get())
    }
}
