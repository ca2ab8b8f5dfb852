//! Names in the log: never the same twice, so that one path means one thing.

use crate::solve::Bone;
use formats::Take;
use std::collections::BTreeSet;

/// The same names, with ` (2)`, ` (3)`, ... behind those that are taken already.
pub(super) fn unique(names: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut taken = BTreeSet::new();
    names
        .into_iter()
        .map(|plain| {
            let mut name = plain.clone();
            let mut count = 1;
            while !taken.insert(name.clone()) {
                count += 1;
                name = format!("{plain} ({count})");
            }
            name
        })
        .collect()
}

/// The name of one end of a bone; a marker without a name is `#` and its number in the file, counted from 1.
pub(super) fn end(name: &str, column: usize) -> String {
    if name.is_empty() { format!("#{}", column + 1) } else { name.to_owned() }
}

/// `NAMEA-NAMEB` for each bone, without subjects' prefixes.
pub(super) fn bones(take: &Take, bones: &[Bone]) -> Vec<String> {
    let end = |column: usize| end(take.markers[column].name(), column);
    unique(bones.iter().map(|bone| format!("{}-{}", end(bone.a), end(bone.b))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_name_is_never_there_twice() {
        let names = ["a", "b", "a", "a (2)", "a"].map(str::to_owned);
        assert_eq!(unique(names), ["a", "b", "a (2)", "a (2) (2)", "a (3)"]);
    }
}
