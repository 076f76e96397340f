//! Fill-reducing elimination order: nested dissection of the contact graph of the grains.

use std::collections::HashMap;

use faer::sparse::{SymbolicSparseColMat, SymbolicSparseColMatRef};

/// Returns the pattern of A + Aᵀ + I, its columns sorted.
pub(crate) fn symmetric_pattern(
    a: SymbolicSparseColMatRef<'_, usize>,
) -> SymbolicSparseColMat<usize> {
    let n = a.ncols();
    let mut columns: Vec<Vec<usize>> = (0..n).map(|j| vec![j]).collect();
    for j in 0..n {
        for &i in a.row_idx_of_col_raw(j) {
            columns[j].push(i);
            columns[i].push(j);
        }
    }
    let (mut column_start, mut row) = (vec![0], Vec::new());
    for mut column in columns {
        column.sort_unstable();
        column.dedup();
        row.extend(column);
        column_start.push(row.len());
    }
    SymbolicSparseColMat::new_checked(n, n, column_start, None, row)
}

/// Returns an elimination order: `order[k]` is the unknown that is eliminated as the k-th.
///
/// Unknowns with equal columns (those of one grain) are one node of the graph, which makes the
/// graph about 36 times smaller. METIS itself gives 5 % less fill than the port used here, but is C
/// behind an unsafe interface. COLAMD, which the LU of faer requires, orders for AᵀA and gives
/// several times the fill (docs/explanation/spectrum.md).
pub(crate) fn nested_dissection(pattern: SymbolicSparseColMatRef<'_, usize>) -> Vec<usize> {
    let n = pattern.ncols();
    let mut node_of_column: HashMap<&[usize], usize> = HashMap::new();
    let mut members: Vec<Vec<usize>> = Vec::new();
    let mut node = vec![0; n];
    for j in 0..n {
        let column = pattern.row_idx_of_col_raw(j);
        node[j] = *node_of_column.entry(column).or_insert_with(|| {
            members.push(Vec::new());
            members.len() - 1
        });
        members[node[j]].push(j);
    }

    let mut start = vec![0];
    let mut neighbour: Vec<i32> = Vec::new();
    for (a, member) in members.iter().enumerate() {
        let rows = pattern.row_idx_of_col_raw(member[0]).iter();
        let rows = rows.map(|&i| node[i] as i32);
        let mut own: Vec<i32> = rows.filter(|b| *b != a as i32).collect();
        own.sort_unstable();
        own.dedup();
        neighbour.extend(own);
        start.push(neighbour.len() as i32);
    }
    let graph = feral_metis::CscPattern::new(members.len(), &start, &neighbour)
        .expect("columns of sorted rows");
    let order = feral_metis::metis_order(&graph).expect("the graph is symmetric");
    order
        .into_iter()
        .flat_map(|node| std::mem::take(&mut members[node as usize]))
        .collect()
}
