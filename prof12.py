import cProfile,pstats,time,deshake,cv2
cv2.setNumThreads(1)
from deshake.run import Run
from deshake.stages.deblurring import deblur
from deshake.formats.photo import read_photo
t=time.time(); ph=read_photo('/tmp/lab/b12/12-megapixels.jpg'); print('read',time.time()-t)
k=deshake.read_kernel('/tmp/lab/b12/k.npz').kernel
pr=cProfile.Profile(); t=time.time(); pr.enable(); r=deblur(ph,k,run=Run(1)); pr.disable(); print('deblur',time.time()-t)
s=pstats.Stats(pr); s.sort_stats('tottime').print_stats(28); s.sort_stats('cumtime').print_stats(45)
