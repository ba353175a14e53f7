# Stiffness of each sample from the touches of a run, with R alone.
#
# Usage: Rscript load.R FOLDER      (arrow::read_parquet reads touches.parquet too)

folder <- commandArgs(trailingOnly = TRUE)[1]
touches <- read.csv(file.path(folder, "touches.csv"),
                    colClasses = c(sample = "character", class = "character"))
measured <- subset(touches, status == "measured")
print(aggregate(stiffness_mpa ~ sample, measured,
                function(x) c(touches = length(x), mean = mean(x), sd = sd(x))))

# The shift falls with the angle.
print(xtabs(shift_hz ~ sample + angle_deg,
            aggregate(shift_hz ~ sample + angle_deg, subset(measured, phase == "main"), mean)))
