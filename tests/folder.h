/* folder.h: removing a test's temporary folder with all that is in it. */
#ifndef LF_TESTS_FOLDER_H
#define LF_TESTS_FOLDER_H

#include <ftw.h>
#include <stdio.h>

static inline int remove_entry(const char *name, const struct stat *info, int kind,
                               struct FTW *where)
{
    (void)info, (void)kind, (void)where;
    return remove(name);
}

/* 0 if all is gone. Links are removed, not followed. */
static inline int remove_tree(const char *folder)
{
    return nftw(folder, remove_entry, 8, FTW_DEPTH | FTW_PHYS);
}

#endif
