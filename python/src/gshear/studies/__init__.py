"""Published studies, repeated on runs of gshear-mpi.

Each module repeats one paper, on tables that gshear-reduce writes, and is a program of its own:

    python -m gshear.studies.lee_hurley RUN... --out FOLDER
    python -m gshear.studies.bonfanti RUN... --out FOLDER

It writes the paper's figures under their numbers with their data as CSV, the paper's numbers next
to those of the runs, and `index.html` with all of them.
"""
