"""The whole loop on a stage with a hidden effect: characterise, scan, diagnose, repair, scan again."""
