"""The side door: photos, camera and kernel files, in and out."""
