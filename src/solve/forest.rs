//! Which things belong together: a union-find over indices.

/// The root of the tree that `at` stands in. `trees` holds each one's parent; roots are their own. Shortens the way for the next one who asks.
pub fn root(trees: &mut [usize], mut at: usize) -> usize {
    while trees[at] != at {
        trees[at] = trees[trees[at]];
        at = trees[at];
    }
    at
}
