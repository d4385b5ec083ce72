//! The layout of a graph of rooms: columns by distance from a room at the edge, rows within them.
//!
//! The layout is the same for the same graph. Its cost grows with the number of ways.

use std::collections::VecDeque;

/// Number of passes that put rooms beside their neighbors.
const PASSES: usize = 6;

/// Returns the place of each node of a graph, as `(x, y)` between 0 and 1. `neighbors` has the
/// neighbors of each node.
pub(crate) fn layout(neighbors: &[Vec<usize>]) -> Vec<(f32, f32)> {
    let mut places = vec![(0.5, 0.5); neighbors.len()];
    let components = components(neighbors);
    let layers: Vec<_> = components.iter().map(|nodes| layers(nodes, neighbors)).collect();
    // Each component has a band of the height, as high as its fullest column.
    let height = |layers: &Vec<Vec<usize>>| layers.iter().map(Vec::len).max().unwrap_or(1);
    let total: usize = layers.iter().map(height).sum();
    let mut above = 0;
    for layers in &layers {
        let columns = layers.len();
        for (column, nodes) in layers.iter().enumerate() {
            let x = if columns == 1 { 0.5 } else { ratio(column, columns - 1) };
            for (row, node) in nodes.iter().enumerate() {
                let within = (ratio(row, 1) + 0.5) / ratio(nodes.len(), 1);
                let y = (ratio(above, 1) + within * ratio(height(layers), 1)) / ratio(total, 1);
                places[*node] = (x, y);
            }
        }
        above += height(layers);
    }
    places
}

/// Returns `part / whole`. The numbers of rooms are small, so that the result is exact enough.
fn ratio(part: usize, whole: usize) -> f32 {
    let small = |number: usize| f32::from(u16::try_from(number).unwrap_or(u16::MAX));
    small(part) / small(whole)
}

/// Returns the components of a graph, the largest one first.
fn components(neighbors: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut seen = vec![false; neighbors.len()];
    let mut components: Vec<Vec<usize>> = Vec::new();
    for start in 0..neighbors.len() {
        if !seen[start] {
            let nodes = distances(start, neighbors);
            nodes.iter().for_each(|(node, _)| seen[*node] = true);
            components.push(nodes.into_iter().map(|(node, _)| node).collect());
        }
    }
    components.sort_by_key(|nodes| std::cmp::Reverse(nodes.len()));
    components
}

/// Returns the nodes that are reached from `start`, each with its distance, the nearest ones first.
fn distances(start: usize, neighbors: &[Vec<usize>]) -> Vec<(usize, usize)> {
    let mut found = vec![false; neighbors.len()];
    found[start] = true;
    let mut open = VecDeque::from([(start, 0)]);
    let mut reached = Vec::new();
    while let Some((node, distance)) = open.pop_front() {
        reached.push((node, distance));
        for next in &neighbors[node] {
            if !std::mem::replace(&mut found[*next], true) {
                open.push_back((*next, distance + 1));
            }
        }
    }
    reached
}

/// Returns the columns of a component: its nodes by their distance from a node at the edge.
fn layers(nodes: &[usize], neighbors: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let Some(first) = nodes.iter().min() else { return Vec::new() };
    let farthest = |from: usize| {
        let reached = distances(from, neighbors);
        let most = reached.last().map_or(0, |(_, distance)| *distance);
        let ends = reached.iter().filter(|(_, distance)| *distance == most);
        ends.map(|(node, _)| *node).min().unwrap_or(from)
    };
    // The farthest node from any node is at the edge.
    let edge = farthest(*first);
    let mut layers: Vec<Vec<usize>> = Vec::new();
    for (node, distance) in distances(edge, neighbors) {
        if layers.len() <= distance {
            layers.push(Vec::new());
        }
        layers[distance].push(node);
    }
    for pass in 0..PASSES {
        sweep(&mut layers, neighbors, pass % 2 == 1);
    }
    layers
}

/// Sorts the rows of each column by the mean row of the neighbors in the column before it; from the
/// right to the left if `backwards`.
fn sweep(layers: &mut [Vec<usize>], neighbors: &[Vec<usize>], backwards: bool) {
    let mut rows = vec![None; neighbors.len()];
    let count = layers.len();
    for step in 0..count {
        let column = if backwards { count - 1 - step } else { step };
        let height = layers[column].len();
        let mean = |node: usize, row: usize| {
            let known: Vec<f32> = neighbors[node].iter().filter_map(|next| rows[*next]).collect();
            let sum: f32 = known.iter().sum();
            if known.is_empty() { position(row, height) } else { sum / ratio(known.len(), 1) }
        };
        let mut sorted: Vec<_> = layers[column]
            .iter()
            .enumerate()
            .map(|(row, node)| (mean(*node, row), *node))
            .collect();
        sorted.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
        layers[column] = sorted.into_iter().map(|(_, node)| node).collect();
        rows.fill(None);
        for (row, node) in layers[column].iter().enumerate() {
            rows[*node] = Some(position(row, height));
        }
    }
}

fn position(row: usize, height: usize) -> f32 {
    (ratio(row, 1) + 0.5) / ratio(height.max(1), 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(nodes: usize, ways: &[(usize, usize)]) -> Vec<Vec<usize>> {
        let mut neighbors = vec![Vec::new(); nodes];
        for (one, other) in ways {
            neighbors[*one].push(*other);
            neighbors[*other].push(*one);
        }
        neighbors
    }

    #[test]
    fn a_corridor_is_between_its_rooms() {
        let places = layout(&graph(4, &[(0, 1), (0, 2), (0, 3)]));
        assert_eq!(places, [(0.5, 0.5), (0.0, 0.5), (1.0, 0.25), (1.0, 0.75)]);
    }

    #[test]
    fn parts_without_a_way_between_them_are_one_below_the_other() {
        let places = layout(&graph(3, &[(1, 2)]));
        assert_eq!(places, [(0.5, 0.75), (1.0, 0.25), (0.0, 0.25)]);
        assert!(layout(&[]).is_empty());
    }

    #[test]
    fn no_two_rooms_of_a_large_building_have_the_same_place() {
        let ways: Vec<_> = (1..200).map(|node| (node / 3, node)).collect();
        let mut places = layout(&graph(200, &ways));
        let is_within = |value: f32| (0.0..=1.0).contains(&value);
        assert!(places.iter().all(|(x, y)| is_within(*x) && is_within(*y)));
        places.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.total_cmp(&other.1)));
        places.dedup();
        assert_eq!(places.len(), 200);
    }
}
