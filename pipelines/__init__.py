"""The commands of tssgeom, a small file each; the mathematics is in the package `tssgeom`."""
