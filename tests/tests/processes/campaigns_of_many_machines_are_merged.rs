//! What campaigns on many machines need beside jink-campaign: the programs that merge and distribute test themselves, without Ray.

use jink_tests::not_tested;
use jink_tests::processes::{answer, workspace};
use std::process::Command;

#[test]
fn programs_that_merge_and_distribute_flights_pass_their_own_tests() {
    if Command::new("python3").arg("--version").output().is_err() {
        not_tested("no python3");
        return;
    }
    for program in ["merge_flights.py", "campaign_on_ray.py"] {
        let path = workspace().join("deploy/campaigns").join(program);
        let tested = answer(Command::new("python3").arg("-B").arg(path).arg("--self-test"));
        assert_eq!(tested.code, Some(0), "{program}: {tested:?}");
        assert!(tested.stderr.contains("\nOK"), "{program}: {tested:?}");
    }
}

#[test]
fn the_script_for_slurm_is_one_that_bash_reads() {
    let script = workspace().join("deploy/campaigns/campaign.sbatch");
    let read = answer(Command::new("bash").arg("-n").arg(script));
    assert_eq!(read.code, Some(0), "{read:?}");
}
