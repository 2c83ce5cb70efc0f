"""The paper's inference: the kernel of one photo and its sharp gradients (Secs. 5 and 7)."""
