"""Kernels of a multilevel method: assembly, aggregates, Galerkin products, relaxation.

Matrices are symmetric, in CSR arrays, rows unsorted but for the diagonal, which comes first;
blocks of m vectors are (n, m) arrays.
"""

from __future__ import annotations

import numpy as np

from synthnet.kernels import kernel


@kernel
def assemble(vertices, faces):  # type: ignore[no-untyped-def]
    """Return stiffness and mass: their pattern, unsorted, the diagonal first; their values.

    A triangle adds minus half the cotangent opposite an edge to its A_ij, and a twelfth of its
    area to B_ij. Also return how many triangles have no area, and how many vertices no triangle.
    """
    n, m = vertices.shape[0], faces.shape[0]
    start = np.zeros(n + 1, np.int32)
    shares = np.empty((m, 4))  # half the cotangents at the corners, a twelfth of the area
    flat = 0
    for f in range(m):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        start[i + 1] += 1
        start[j + 1] += 1
        start[k + 1] += 1
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        ux, uy, uz = vertices[j, 0] - x, vertices[j, 1] - y, vertices[j, 2] - z
        wx, wy, wz = vertices[k, 0] - x, vertices[k, 1] - y, vertices[k, 2] - z
        uu = ux * ux + uy * uy + uz * uz
        ww = wx * wx + wy * wy + wz * wz
        uw = ux * wx + uy * wy + uz * wz
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        doubled = np.sqrt(nx * nx + ny * ny + nz * nz)
        if not doubled > 0:
            flat += 1
        half = 0.5 / doubled
        shares[f, 0], shares[f, 1], shares[f, 2] = half * uw, half * (uu - uw), half * (ww - uw)
        shares[f, 3] = doubled / 24
    for i in range(n):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    around = np.empty(3 * m, np.int32)  # the corners at each vertex
    for f in range(m):
        for c in range(3):
            i = faces[f, c]
            around[fill[i]] = 3 * f + c
            fill[i] += 1
    indptr = np.empty(n + 1, np.int32)
    room = 6 * m + n
    indices, stiffness, mass = np.empty(room, np.int32), np.empty(room), np.empty(room)
    place = np.full(n, -1, np.int32)  # of a column in the row at work
    count, unused = 0, 0
    for i in range(n):
        first = count
        indptr[i] = first
        indices[first], stiffness[first], mass[first] = i, 0.0, 0.0
        count += 1
        if start[i] == start[i + 1]:
            unused += 1
        for p in range(start[i], start[i + 1]):
            f, c = around[p] // 3, around[p] % 3
            for step in range(1, 3):
                j = faces[f, (c + step) % 3]
                if place[j] < first:
                    place[j] = count
                    indices[count], stiffness[count], mass[count] = j, 0.0, 0.0
                    count += 1
                opposite = shares[f, (c + 3 - step) % 3]
                stiffness[place[j]] -= opposite
                stiffness[first] += opposite
                mass[place[j]] += shares[f, 3]
                mass[first] += shares[f, 3]
    indptr[n] = count
    return indptr, indices[:count], stiffness[:count], mass[:count], flat, unused


@kernel
def aggregates(indptr, indices, stiffness, strength):  # type: ignore[no-untyped-def]
    """Return the number of each vertex's aggregate, and how many there are.

    Neighbours are strong if −a_ij is at least ``strength`` times the largest of both rows. First,
    a vertex whose strong neighbours are all free makes an aggregate of them and itself. What is
    left joins the aggregate of its strongest neighbour; where there is none, it makes one with
    the strong neighbours that are free.
    """
    n = indptr.shape[0] - 1
    of = np.full(n, -1, np.int32)
    least = np.empty(n)  # of −a_ij that are strong
    count = 0
    for i in range(n):
        largest = 0.0
        for p in range(indptr[i] + 1, indptr[i + 1]):
            largest = max(largest, -stiffness[p])
        least[i] = strength * largest if largest > 0 else np.inf
    for i in range(n):
        free = of[i] < 0
        p = indptr[i] + 1
        while free and p < indptr[i + 1]:
            free = of[indices[p]] < 0 or -stiffness[p] < max(least[i], least[indices[p]])
            p += 1
        if free:
            for p in range(indptr[i] + 1, indptr[i + 1]):
                if -stiffness[p] >= max(least[i], least[indices[p]]):
                    of[indices[p]] = count
            of[i] = count
            count += 1
    first = of.copy()
    for i in range(n):
        if first[i] < 0:
            strongest = 0.0  # ties go to the first, whatever the rounding
            for p in range(indptr[i] + 1, indptr[i + 1]):
                if first[indices[p]] >= 0 and -stiffness[p] > 1.001 * strongest:
                    strongest = -stiffness[p]
                    of[i] = first[indices[p]]
    for i in range(n):
        if of[i] < 0:
            for p in range(indptr[i] + 1, indptr[i + 1]):
                if of[indices[p]] < 0 and -stiffness[p] >= max(least[i], least[indices[p]]):
                    of[indices[p]] = count
            of[i] = count
            count += 1
    return of, count


@kernel
def prolongation(indptr, indices, stiffness, of, weight, least):  # type: ignore[no-untyped-def]
    """Return the prolongation P as CSR: of aggregates, smoothed by one step of Jacobi's kind.

    A row is 1 − ω at its vertex's aggregate, and ω shared out to those of its neighbours by
    −a_ij where that is positive; so rows are not negative and sum to 1. Shares below ``least``
    go to the others: the coarse matrices are sparser for it.
    """
    n = indptr.shape[0] - 1
    start = np.zeros(n + 1, np.int32)
    columns, values = np.empty(indices.shape[0], np.int32), np.empty(indices.shape[0])
    seen, place = np.full(n, -1, np.int32), np.empty(n, np.int32)  # of an aggregate in the row
    count = 0
    for i in range(n):
        own = count
        columns[own], values[own] = of[i], 0.0
        seen[of[i]], place[of[i]] = i, own
        count += 1
        total = 0.0
        for p in range(indptr[i] + 1, indptr[i + 1]):
            share = -stiffness[p]
            if share > 0:
                total += share
                aggregate = of[indices[p]]
                if seen[aggregate] != i:
                    seen[aggregate], place[aggregate] = i, count
                    columns[count], values[count] = aggregate, 0.0
                    count += 1
                values[place[aggregate]] += share
        kept, end = values[own], own + 1
        for p in range(own + 1, count):
            if values[p] >= least * total:
                kept += values[p]
                columns[end], values[end] = columns[p], values[p]
                end += 1
        count = end
        scale = weight / kept if kept > 0 else 0.0
        values[own] = 1.0
        for p in range(own + 1, count):
            values[p] *= scale
            values[own] -= values[p]
        start[i + 1] = count
    return start, columns[:count], values[:count]


@kernel
def transposed(start, columns, values, m):  # type: ignore[no-untyped-def]
    """Return the transpose of a CSR matrix with m columns."""
    begin = np.zeros(m + 1, np.int32)
    for p in range(columns.shape[0]):
        begin[columns[p] + 1] += 1
    for i in range(m):
        begin[i + 1] += begin[i]
    fill = begin[:-1].copy()
    rows, entries = np.empty_like(columns), np.empty_like(values)
    for i in range(start.shape[0] - 1):
        for p in range(start[i], start[i + 1]):
            q = fill[columns[p]]
            rows[q], entries[q] = i, values[p]
            fill[columns[p]] = q + 1
    return begin, rows, entries


@kernel
def times_both(indptr, indices, a, b, start, columns, values, m):  # type: ignore[no-untyped-def]
    """Return the pattern of A P, and the values of A P and B P; P has m columns."""
    n = indptr.shape[0] - 1
    begin = np.zeros(n + 1, np.int32)
    room = 8 * n + 64
    found, both = np.empty(room, np.int32), np.empty((room, 2))
    seen, sums = np.full(m, -1, np.int32), np.zeros((m, 2))
    count = 0
    for i in range(n):
        first, most = count, count
        for p in range(indptr[i], indptr[i + 1]):
            most += start[indices[p] + 1] - start[indices[p]]
        if most >= room:
            found = np.append(found, np.empty(most, np.int32))
            both = np.concatenate((both, np.empty((most, 2))))
            room += most
        for p in range(indptr[i], indptr[i + 1]):
            j, v, w = indices[p], a[p], b[p]
            for q in range(start[j], start[j + 1]):
                k, value = columns[q], values[q]
                found[count] = k  # is overwritten unless it is new: cheaper than a branch
                count += seen[k] != i
                seen[k] = i
                sums[k, 0] += v * value
                sums[k, 1] += w * value
        for p in range(first, count):
            k = found[p]
            both[p, 0], both[p, 1] = sums[k, 0], sums[k, 1]
            sums[k, 0] = sums[k, 1] = 0.0
        begin[i + 1] = count
    return begin, found, both


@kernel
def of_both(start, columns, values, begin, found, both):  # type: ignore[no-untyped-def]
    """Return the pattern of Q A P, the diagonal first, and the values of Q A P and Q B P.

    Q is the transpose of P.
    """
    m = start.shape[0] - 1
    indptr = np.zeros(m + 1, np.int32)
    room = 20 * m + 64
    indices, a, b = np.empty(room, np.int32), np.empty(room), np.empty(room)
    seen, sums = np.full(m, -1, np.int32), np.zeros((m, 2))
    count = 0
    for i in range(m):
        first, most = count, count + 1
        for p in range(start[i], start[i + 1]):
            most += begin[columns[p] + 1] - begin[columns[p]]
        if most >= room:
            indices = np.append(indices, np.empty(most, np.int32))
            a, b = np.append(a, np.empty(most)), np.append(b, np.empty(most))
            room += most
        seen[i] = i
        indices[count] = i
        count += 1
        for p in range(start[i], start[i + 1]):
            j, v = columns[p], values[p]
            for q in range(begin[j], begin[j + 1]):
                k = found[q]
                indices[count] = k
                count += seen[k] != i
                seen[k] = i
                sums[k, 0] += v * both[q, 0]
                sums[k, 1] += v * both[q, 1]
        for p in range(first, count):
            k = indices[p]
            a[p], b[p] = sums[k, 0], sums[k, 1]
            sums[k, 0] = sums[k, 1] = 0.0
        indptr[i + 1] = count
    return indptr, indices[:count], a[:count], b[:count]


@kernel
def multiply(indptr, indices, values, x, scales, y):  # type: ignore[no-untyped-def]
    """Set y to the product of a matrix and x, its columns scaled."""
    m = x.shape[1]
    for i in range(indptr.shape[0] - 1):
        for c in range(m):
            y[i, c] = 0.0
        for p in range(indptr[i], indptr[i + 1]):
            j, value = indices[p], values[p]
            for c in range(m):
                y[i, c] += value * x[j, c]
        for c in range(m):
            y[i, c] *= scales[c]


@kernel
def multiply_both(indptr, indices, a, b, x, ax, bx):  # type: ignore[no-untyped-def]
    """Set ax and bx to the products of two matrices of one pattern and x."""
    m = x.shape[1]
    for i in range(indptr.shape[0] - 1):
        for c in range(m):
            ax[i, c] = 0.0
            bx[i, c] = 0.0
        for p in range(indptr[i], indptr[i + 1]):
            j, v, w = indices[p], a[p], b[p]
            for c in range(m):
                ax[i, c] += v * x[j, c]
                bx[i, c] += w * x[j, c]


@kernel
def relax(indptr, indices, a, right, x, down):  # type: ignore[no-untyped-def]
    """Improve x towards A x = right: one sweep of Gauss-Seidel, down the rows or up."""
    n, m = x.shape
    defect = np.empty(m)
    for step in range(n):
        i = step if down else n - 1 - step
        for c in range(m):
            defect[c] = right[i, c]
        for p in range(indptr[i], indptr[i + 1]):
            j, value = indices[p], a[p]
            for c in range(m):
                defect[c] -= value * x[j, c]
        diagonal = a[indptr[i]]
        if diagonal > 0:
            inverse = 1 / diagonal
            for c in range(m):
                x[i, c] += inverse * defect[c]


@kernel
def restrict(indptr, indices, a, right, x, start, columns, values, coarse):  # type: ignore[no-untyped-def]
    """Add Pᵀ (right − A x) to coarse."""
    n, m = x.shape
    defect = np.empty(m)
    for i in range(n):
        for c in range(m):
            defect[c] = right[i, c]
        for p in range(indptr[i], indptr[i + 1]):
            j, value = indices[p], a[p]
            for c in range(m):
                defect[c] -= value * x[j, c]
        for p in range(start[i], start[i + 1]):
            k, value = columns[p], values[p]
            for c in range(m):
                coarse[k, c] += value * defect[c]


@kernel
def prolong(start, columns, values, coarse, x):  # type: ignore[no-untyped-def]
    """Add P coarse to x."""
    n, m = x.shape
    for i in range(n):
        for p in range(start[i], start[i + 1]):
            k, value = columns[p], values[p]
            for c in range(m):
                x[i, c] += value * coarse[k, c]
