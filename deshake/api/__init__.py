"""The functions of ``import deshake``: arrays or photos in, arrays or photos out."""
