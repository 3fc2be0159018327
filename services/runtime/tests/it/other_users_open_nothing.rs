//! What an instance has in shared memory is its user's: iceoryx2 makes some of it for all users.

use jink_runtime::{Instance, Session};
use jink_shared_types::topics;

#[test]
fn whatever_a_session_makes_in_shared_memory_is_closed_to_others() {
    let instance: Instance = format!("rt_rights_{}", std::process::id()).parse().unwrap();
    let session = Session::open(&instance, "mavlink_gateway").unwrap();
    let at_first = instance.open_to_others();
    let ports = (
        session.output(topics::LINK_STATUS, "", 1).unwrap(),
        session.input(topics::APPROVED, "").unwrap(),
    );
    let open = instance.open_to_others();
    drop((ports, session));
    instance.wipe().unwrap();
    std::fs::remove_dir_all(instance.folder()).unwrap();
    assert!(at_first.is_empty() && open.is_empty(), "{at_first:?}, {open:?}");
}
