//! Strongly connected components of a graph. They show cycles of types and of axioms, here and in
//! the planner.
//!
//! The components are found in linear time and without recursion, because the graphs come from
//! untrusted text.

/// Returns a component number for each node (Kosaraju's algorithm). Two nodes have the same number
/// if and only if they reach each other.
///
/// `successors` has the targets of the edges of each node.
pub fn components(successors: &[Vec<usize>]) -> Vec<usize> {
    let mut predecessors = vec![Vec::new(); successors.len()];
    for (node, targets) in successors.iter().enumerate() {
        for target in targets {
            predecessors[*target].push(node);
        }
    }
    let mut components = vec![None; successors.len()];
    for (component, root) in finished_order(successors).into_iter().rev().enumerate() {
        let mut open = vec![root];
        while let Some(node) = open.pop() {
            if components[node].is_none() {
                components[node] = Some(component);
                open.extend(&predecessors[node]);
            }
        }
    }
    components.into_iter().flatten().collect()
}

/// Returns all nodes in an order in which each node comes after all nodes that it reaches. Within a
/// cycle the order is arbitrary.
fn finished_order(successors: &[Vec<usize>]) -> Vec<usize> {
    let mut finished = Vec::with_capacity(successors.len());
    let mut seen = vec![false; successors.len()];
    for root in 0..successors.len() {
        if seen[root] {
            continue;
        }
        seen[root] = true;
        let mut path = vec![(root, 0)];
        while let Some((node, edge)) = path.last_mut() {
            match successors[*node].get(*edge) {
                Some(target) => {
                    *edge += 1;
                    if !seen[*target] {
                        seen[*target] = true;
                        path.push((*target, 0));
                    }
                }
                None => {
                    finished.push(*node);
                    path.pop();
                }
            }
        }
    }
    finished
}

#[cfg(test)]
mod tests {
    use super::components;

    /// Checks the components of a graph. `edges` are pairs of nodes; `expected` groups the nodes by
    /// component.
    #[track_caller]
    fn check(nodes: usize, edges: &[(usize, usize)], expected: &[&[usize]]) {
        let mut successors = vec![Vec::new(); nodes];
        for (from, to) in edges {
            successors[*from].push(*to);
        }
        let components = components(&successors);
        for left in 0..nodes {
            for right in 0..nodes {
                let together = expected.iter().any(|it| it.contains(&left) && it.contains(&right));
                assert_eq!(components[left] == components[right], together, "{left} {right}");
            }
        }
    }

    #[test]
    fn a_chain_forms_no_component_of_several_nodes() {
        check(3, &[(0, 1), (1, 2), (0, 2)], &[&[0], &[1], &[2]]);
    }

    #[test]
    fn cycles_are_found_next_to_other_cycles() {
        let edges = [(4, 0), (0, 1), (1, 0), (1, 2), (2, 3), (3, 2), (5, 5)];
        check(6, &edges, &[&[0, 1], &[2, 3], &[4], &[5]]);
    }
}
