"""What is measured and made with the planner: tasks, dataset, training, benchmark, reports, figures, notebooks."""
