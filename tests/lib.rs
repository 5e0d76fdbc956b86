//! What the tests share.

use voidage_campaign::Effort;
use voidage_verification::{cases, solve};

/// Solves the quick form of all cases of a group of the verification suite.
///
/// # Panics
/// If a finding is outside of what is allowed.
pub fn verify_quickly(group: &str) {
    let mut missed = Vec::new();
    let chosen: Vec<_> = cases().into_iter().filter(|case| case.group == group).collect();
    assert!(!chosen.is_empty(), "there is no case in the group {group}");
    for case in chosen {
        let outcome = solve(&case, Effort::Quick);
        assert!(!outcome.findings.is_empty(), "{} finds nothing", case.name);
        let outside = outcome.findings.into_iter().filter(|finding| !finding.passes());
        missed.extend(outside.map(|finding| format!("{}: {finding:?}", case.name)));
    }
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}
