//! What a process asks of the kernel's scheduler is granted, or refused in words: nobody flies on rights that he only believes to have.

use jink_runtime::realtime::{RealtimeWish, Scheduling, apply, bind_to_core, cpu_time_ms, schedule};
use std::process::Command;

/// Policies as /proc has them.
const OTHER: i32 = 0;
const FIFO: i32 = 1;

#[test]
fn an_impossible_priority_is_refused_in_words_and_what_is_possible_is_done() {
    let refused = std::thread::spawn(|| {
        apply(RealtimeWish {
            priority: 100,
            core: Some(first_core()),
            lock_memory: false,
        })
    });
    let refused = refused.join().unwrap();
    assert_eq!(refused.len(), 1, "{refused:?}");
    assert!(refused[0].contains("SCHED_FIFO priority 100"), "{refused:?}");
}

#[test]
fn a_process_that_is_gone_cannot_be_scheduled() {
    let mut child = Command::new("true").spawn().unwrap();
    child.wait().unwrap();
    let refused = schedule(child.id(), Scheduling::Ordinary).unwrap_err();
    assert_eq!(
        refused.raw_os_error(),
        Some(rustix::io::Errno::SRCH.raw_os_error()),
        "{refused}"
    );
    let no_id = schedule(u32::MAX, Scheduling::Ordinary);
    assert!(no_id.is_err(), "no process has such an id");
}

#[test]
fn a_thread_stays_on_the_core_that_it_is_bound_to_and_the_others_do_not() {
    let before = cores();
    let bound = std::thread::spawn(|| {
        bind_to_core(first_core()).unwrap();
        cores()
    });
    assert_eq!(bound.join().unwrap(), [first_core()]);
    assert_eq!(cores(), before);
}

#[test]
fn the_time_of_the_process_counts_what_it_computes() {
    let begin = cpu_time_ms();
    let mut number = 1_u64;
    while cpu_time_ms() < begin + 20 {
        number = std::hint::black_box(number.wrapping_mul(3));
    }
    assert!(cpu_time_ms() >= begin + 20);
}

/// What a service starts is to be as it is, or ordinary, as it was asked for.
#[test]
fn a_priority_is_inherited_only_where_that_is_wanted() {
    let child_of = |scheduling| {
        std::thread::spawn(move || {
            schedule(0, scheduling)?;
            let reported = Command::new("cat").arg("/proc/self/stat").output()?;
            Ok::<_, std::io::Error>(policy(&String::from_utf8_lossy(&reported.stdout)))
        })
        .join()
        .unwrap()
    };
    assert_eq!(child_of(Scheduling::Ordinary).unwrap(), (0, 0));
    match (child_of(Scheduling::Fifo(1)), child_of(Scheduling::FifoItself(1))) {
        (Ok(inherits), Ok(is_ordinary)) => {
            assert_eq!(inherits, (1, FIFO));
            assert_eq!(is_ordinary, (0, OTHER));
        }
        (Err(refused), _) | (_, Err(refused)) => {
            assert_eq!(
                refused.raw_os_error(),
                Some(rustix::io::Errno::PERM.raw_os_error()),
                "{refused}"
            );
            jink_testkit::not_tested("no right to SCHED_FIFO");
        }
    }
}

/// Priority and policy out of `/proc/<pid>/stat`: fields 40 and 41, those after the name counted from the third.
fn policy(stat: &str) -> (i32, i32) {
    let (_, fields) = stat.rsplit_once(')').unwrap();
    let fields: Vec<&str> = fields.split_whitespace().collect();
    (fields[37].parse().unwrap(), fields[38].parse().unwrap())
}

/// The cores that the calling thread may run on.
fn cores() -> Vec<usize> {
    let set = rustix::thread::sched_getaffinity(None).unwrap();
    (0..rustix::thread::CpuSet::MAX_CPU)
        .filter(|core| set.is_set(*core))
        .collect()
}

fn first_core() -> usize {
    cores()[0]
}
