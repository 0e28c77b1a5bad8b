"""Dark frames, exposure brackets, flat fields and bands photographed one by one."""
