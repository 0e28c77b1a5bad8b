"""Every spline coefficient vector in the unit box that gives one signal: uniform draws and exact
bounds.
"""
